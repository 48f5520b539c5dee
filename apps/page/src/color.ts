// Colour: the same definitions as image/color.h, so that the page's errors are the table's.

const THRESHOLD = 216 / 24389;
const KAPPA = 24389 / 27;
const XYZ = [
  [0.4124564 / 0.95047, 0.3575761 / 0.95047, 0.1804375 / 0.95047],
  [0.2126729, 0.7151522, 0.072175],
  [0.0193339 / 1.08883, 0.119192 / 1.08883, 0.9503041 / 1.08883],
] as const;

function labCurve(t: number): number {
  return t > THRESHOLD ? Math.cbrt(t) : (KAPPA * t + 16) / 116;
}

/** CIE-Lab (D65) of linear Rec. 709, written to `out[at..at+2]`. */
export function labFromRgb(r: number, g: number, b: number, out: Float32Array, at: number): void {
  const fx = labCurve(XYZ[0][0] * r + XYZ[0][1] * g + XYZ[0][2] * b);
  const fy = labCurve(XYZ[1][0] * r + XYZ[1][1] * g + XYZ[1][2] * b);
  const fz = labCurve(XYZ[2][0] * r + XYZ[2][1] * g + XYZ[2][2] * b);
  out[at] = 116 * fy - 16;
  out[at + 1] = 500 * (fx - fy);
  out[at + 2] = 200 * (fy - fz);
}

export function luminance(r: number, g: number, b: number): number {
  return XYZ[1][0] * r + XYZ[1][1] * g + XYZ[1][2] * b;
}

export function srgbEncode(linear: number): number {
  const v = Math.min(Math.max(linear, 0), 1);
  return v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055;
}

/** A soft shoulder above middle grey, as `brume picture` has. */
export function filmicShoulder(linear: number): number {
  const grey = 0.18;
  if (!(linear > grey)) return linear;
  return 1 - (1 - grey) / (1 + (linear - grey) / (1 - grey));
}

export const TONES = ["srgb", "filmic", "log"] as const;
export type Tone = (typeof TONES)[number];

export const TONE_NAMES: Record<Tone, string> = {
  srgb: "sRGB, clipped",
  filmic: "Soft shoulder",
  log: "Logarithm, 12 stops",
};

/** Display value in [0, 1] of linear light. */
export function toneMap(tone: Tone, linear: number): number {
  switch (tone) {
    case "srgb":
      return srgbEncode(linear);
    case "filmic":
      return srgbEncode(filmicShoulder(linear));
    case "log":
      // From 8 stops below white to 4 above.
      return linear > 0 ? Math.min(Math.max((Math.log2(linear) + 8) / 12, 0), 1) : 0;
  }
}

/** An opaque colour, 8 bits each. */
export type Rgb8 = readonly [number, number, number];

/** Oklab to sRGB, clipped. */
export function rgbFromOklab(L: number, a: number, b: number): Rgb8 {
  const l = (L + 0.3963377774 * a + 0.2158037573 * b) ** 3;
  const m = (L - 0.1055613458 * a - 0.0638541728 * b) ** 3;
  const s = (L - 0.0894841775 * a - 1.291485548 * b) ** 3;
  const byte = (v: number) => Math.round(255 * srgbEncode(v));
  return [
    byte(4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s),
    byte(-1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s),
    byte(-0.0041960863 * l - 0.7034186147 * m + 1.707614701 * s),
  ];
}

/** Lightness, chroma and hue (degrees) of Oklab at places along a colour map. */
type Stop = readonly [place: number, L: number, C: number, h: number];

function mapFrom(stops: readonly Stop[]): Uint8ClampedArray {
  const table = new Uint8ClampedArray(256 * 3);
  for (let i = 0; i < 256; ++i) {
    const t = i / 255;
    let k = 1;
    while (k + 1 < stops.length && stops[k]![0] < t) ++k;
    const [t0, L0, C0, h0] = stops[k - 1]!;
    const [t1, L1, C1, h1] = stops[k]!;
    const w = (t - t0) / (t1 - t0);
    const hue = ((h0 + w * (h1 - h0)) * Math.PI) / 180;
    const chroma = C0 + w * (C1 - C0);
    table.set(rgbFromOklab(L0 + w * (L1 - L0), chroma * Math.cos(hue), chroma * Math.sin(hue)), 3 * i);
  }
  return table;
}

/** For errors: black, violet, red, yellow, nearly white; its lightness rises evenly, so that it reads in grey too. */
export const EMBER = mapFrom([
  [0, 0.09, 0.015, 290],
  [0.25, 0.31, 0.13, 305],
  [0.5, 0.53, 0.19, 372],
  [0.75, 0.75, 0.15, 415],
  [1, 0.97, 0.07, 462],
]);

/** For signed differences: blue below, dark in the middle, orange above. */
export const BLUE_ORANGE = mapFrom([
  [0, 0.86, 0.09, 225],
  [0.25, 0.6, 0.13, 245],
  [0.5, 0.15, 0, 245],
  [0.5, 0.15, 0, 50],
  [0.75, 0.62, 0.15, 50],
  [1, 0.9, 0.1, 80],
]);

/** A CSS gradient that shows a colour map. */
export function cssGradient(map: Uint8ClampedArray): string {
  const stops: string[] = [];
  for (let i = 0; i <= 16; ++i) {
    const at = 3 * Math.round((255 * i) / 16);
    stops.push(`rgb(${map[at]} ${map[at + 1]} ${map[at + 2]})`);
  }
  return `linear-gradient(to right, ${stops.join(", ")})`;
}
