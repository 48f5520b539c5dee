// A picture of half floats, and how a display shows it.
import { toneMap, type Tone } from "./color";
import { floatOfHalf, tableOfHalf } from "./half";

export class Picture {
  constructor(
    readonly width: number,
    readonly height: number,
    /** Planes R, G, B. */
    readonly half: Uint16Array,
  ) {}

  rgb(x: number, y: number): [number, number, number] {
    const size = this.width * this.height;
    const at = y * this.width + x;
    return [floatOfHalf(this.half[at]!), floatOfHalf(this.half[size + at]!), floatOfHalf(this.half[2 * size + at]!)];
  }
}

let latest: { tone: Tone; exposure: number; table: Uint8ClampedArray } | undefined;

/** What a display shows of each half float; pictures in a row are mostly shown alike. */
function displayTable(tone: Tone, exposure: number): Uint8ClampedArray {
  if (latest?.tone !== tone || latest.exposure !== exposure) {
    const table = tableOfHalf(new Uint8ClampedArray(65536), (v) => 255 * toneMap(tone, v * exposure));
    latest = { tone, exposure, table };
  }
  return latest.table;
}

/** 8-bit RGBA of a picture as a display shows it. */
export function colourPicture(picture: Picture, tone: Tone, exposure: number, out: Uint8ClampedArray): void {
  const size = picture.width * picture.height;
  const display = displayTable(tone, exposure);
  for (let i = 0; i < size; ++i) {
    out[4 * i] = display[picture.half[i]!]!;
    out[4 * i + 1] = display[picture.half[size + i]!]!;
    out[4 * i + 2] = display[picture.half[2 * size + i]!]!;
    out[4 * i + 3] = 255;
  }
}
