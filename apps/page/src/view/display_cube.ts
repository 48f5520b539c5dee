// A display of an OpenColorIO configuration, as the program tabulates it (apps/view/display_cube.h).
import { floatOfHalf, tableOfHalf } from "../half";

const HEADER = 4;

export class DisplayCube {
  /** Where each half float lies between the nodes: its cell, and how far in it. */
  private place: { exposure: number; table: Float32Array } | undefined;

  constructor(
    readonly name: string,
    /** Nodes along an edge. */
    readonly side: number,
    /** Of the first node that is not black, as a power of two; there are `perStop` nodes for each doubling. */
    readonly lowest: number,
    readonly perStop: number,
    /** Display values of the nodes, RGB after RGB, red fastest, 65535 for white. */
    readonly values: Uint16Array,
  ) {}

  /** @throws Error for what is no cube */
  static decode(bytes: ArrayBuffer): DisplayCube {
    const length = new DataView(bytes).getUint32(0, true);
    const header = JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, HEADER, length))) as {
      name: string;
      side: number;
      lowest: number;
      per_stop: number;
    };
    const values = new Uint16Array(bytes.slice(HEADER + length));
    if (values.length !== 3 * header.side ** 3)
      throw new Error(`a display of ${header.side} nodes cannot have ${values.length} values`);
    return new DisplayCube(header.name, header.side, header.lowest, header.per_stop, values);
  }

  private places(exposure: number): Float32Array {
    if (this.place?.exposure !== exposure) {
      const first = 2 ** this.lowest;
      const last = this.side - 1;
      const table = tableOfHalf(new Float32Array(65536), (half) => {
        const v = half * exposure;
        if (!(v > 0)) return 0;
        return Math.min(last, v < first ? v / first : 1 + this.perStop * (Math.log2(v) - this.lowest));
      });
      this.place = { exposure, table };
    }
    return this.place.table;
  }

  /** 8-bit RGBA of planes R, G, B: between nodes by tetrahedra, on which grey stays grey. What is not finite is magenta,
   *  as in the program's pictures. */
  colour(half: Uint16Array, exposure: number, out: Uint8ClampedArray): void {
    const { side, values } = this;
    const places = this.places(exposure);
    const size = half.length / 3;
    const strides = [3, 3 * side, 3 * side * side] as const;
    const at = [0, 0, 0];
    for (let i = 0; i < size; ++i) {
      const to = 4 * i;
      out[to + 3] = 255;
      let finite = true;
      let node = 0;
      for (let c = 0; c < 3; ++c) {
        const bits = half[c * size + i]!;
        finite &&= Number.isFinite(floatOfHalf(bits));
        const place = places[bits]!;
        const cell = Math.min(Math.floor(place), side - 2);
        at[c] = place - cell;
        node += cell * strides[c]!;
      }
      if (!finite) {
        out[to] = 255;
        out[to + 1] = 0;
        out[to + 2] = 255;
        continue;
      }
      // From the cell's first corner to its last along the axes in the order of how far the place is along them.
      const [r, g, b] = at as [number, number, number];
      const most = r >= g ? (r >= b ? 0 : 2) : g >= b ? 1 : 2;
      const least = r < g ? (r <= b ? 0 : 2) : g < b || (g === b && most !== 1) ? 1 : 2;
      const middle = 3 - most - least;
      const second = node + strides[most]!;
      const third = second + strides[middle]!;
      const last = third + strides[least]!;
      const [a, m, l] = [at[most]!, at[middle]!, at[least]!];
      for (let c = 0; c < 3; ++c)
        out[to + c] =
          ((1 - a) * values[node + c]! + (a - m) * values[second + c]! + (m - l) * values[third + c]! + l * values[last + c]!) /
          257;
    }
  }
}
