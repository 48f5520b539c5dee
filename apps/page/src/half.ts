// Half floats as image/packed_half.h packs them: residuals of a predictor in two byte planes, in one zlib stream.

const FLOAT_OF_HALF = /* @__PURE__ */ (() => {
  const table = new Float32Array(65536);
  for (let bits = 0; bits < 65536; ++bits) {
    const sign = bits & 0x8000 ? -1 : 1;
    const exponent = (bits >> 10) & 31;
    const fraction = bits & 1023;
    table[bits] =
      exponent === 31
        ? fraction
          ? NaN
          : sign * Infinity
        : exponent
          ? sign * 2 ** (exponent - 15) * (1 + fraction / 1024)
          : sign * 2 ** -14 * (fraction / 1024);
  }
  return table;
})();

/** The value of a half float's 16 bits. */
export function floatOfHalf(bits: number): number {
  return FLOAT_OF_HALF[bits]!;
}

/** A table with an entry for each half float: the fastest way to map a picture's values. */
export function tableOfHalf<T extends { [index: number]: number }>(table: T, value: (x: number) => number): T {
  for (let bits = 0; bits < 65536; ++bits) table[bits] = value(FLOAT_OF_HALF[bits]!);
  return table;
}

export async function inflate(bytes: Uint8Array<ArrayBuffer>): Promise<Uint8Array> {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

export function fromBase64(text: string): Uint8Array<ArrayBuffer> {
  const binary = atob(text);
  const bytes = new Uint8Array(binary.length);
  for (let i = 0; i < binary.length; ++i) bytes[i] = binary.charCodeAt(i);
  return bytes;
}

/** The half closest to a neighbourhood's trend: of the sum of the smooth prediction and its two neighbours, the middle
 *  one (the predictor of JPEG-LS). */
function predict(left: number, up: number, corner: number): number {
  const low = left < up ? left : up;
  const high = left < up ? up : left;
  return corner >= high ? low : corner <= low ? high : left + up - corner;
}

/**
 * Undoes the prediction.
 * @param bytes  high bytes of all residuals, then their low bytes; planes G, R - G, B - G of `width * height` each
 * @returns half floats, planes R, G, B
 */
export function unpredict(bytes: Uint8Array, width: number, height: number): Uint16Array {
  const size = width * height;
  if (bytes.length !== 6 * size) throw new Error(`a picture of ${width} x ${height} cannot have ${bytes.length} bytes`);
  const planes = [new Uint16Array(size), new Uint16Array(size), new Uint16Array(size)] as const;
  for (let c = 0; c < 3; ++c) {
    const plane = planes[c]!;
    for (let y = 0, i = 0; y < height; ++y)
      for (let x = 0; x < width; ++x, ++i) {
        const left = x ? plane[i - 1]! : y ? plane[i - width]! : 32768;
        const up = y ? plane[i - width]! : left;
        const corner = x && y ? plane[i - width - 1]! : up;
        const folded = (bytes[c * size + i]! << 8) | bytes[3 * size + c * size + i]!;
        plane[i] = predict(left, up, corner) + ((folded >> 1) ^ -(folded & 1));
      }
  }
  const [green, red, blue] = planes;
  const result = new Uint16Array(3 * size);
  for (let i = 0; i < size; ++i) {
    const g = green[i]!;
    result[i] = unordered((g + red[i]! - 32768) & 65535);
    result[size + i] = unordered(g);
    result[2 * size + i] = unordered((g + blue[i]! - 32768) & 65535);
  }
  return result;
}

/** From integers in the order of the values back to sign and magnitude. */
function unordered(ordered: number): number {
  return ordered & 0x8000 ? ordered & 0x7fff : ~ordered & 0xffff;
}
