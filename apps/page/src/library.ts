// The embedded pictures: unpacked when they are first asked for, and turned into what is seen.
import { BLUE_ORANGE, EMBER, labFromRgb, luminance, type Tone } from "./color";
import { floatOfHalf, fromBase64, inflate, tableOfHalf, unpredict } from "./half";
import { colourPicture, Picture } from "./picture";
import { REFERENCE, type PictureEntry } from "./results";

export const ERROR_KINDS = ["lab", "luminance", "relative"] as const;
export type ErrorKind = (typeof ERROR_KINDS)[number];

/** Names of the error maps, and the value at the end of their colours before it is doubled or halved. */
export const ERRORS: Record<ErrorKind, { name: string; short: string; unit: string; full: number; signed: boolean }> = {
  lab: { name: "Lab distance", short: "Lab distance", unit: "Lab units", full: 10, signed: false },
  luminance: {
    name: "Luminance, too dark or too bright",
    short: "Δ luminance",
    unit: "of white",
    full: 0.1,
    signed: true,
  },
  relative: { name: "Relative squared error", short: "rel. squared", unit: "", full: 0.05, signed: false },
};

/** What the maps are of A and B. */
export const DIFFERENCES: Record<ErrorKind, string> = {
  lab: "Lab distance of A and B",
  luminance: "Luminance of A minus B",
  relative: "Relative squared difference",
};

/** How a pane's pixels get their colours: as a display shows them, or by what they differ in from another picture. */
export type Look =
  | { show: "picture"; tone: Tone; exposure: number }
  | { show: "error"; kind: ErrorKind; full: number; exposure: number; base: string };

const clipped = (v: number) => (v < 0 ? 0 : v > 1 ? 1 : v);

/** Errors pixel by pixel. Lab is clipped after exposure, as the table's is. */
export function errorMap(kind: ErrorKind, picture: Picture, reference: Picture, exposure: number): Float32Array {
  const size = picture.width * picture.height;
  const result = new Float32Array(size);
  const shown = tableOfHalf(new Float32Array(65536), (v) => clipped(v * exposure));
  const a = picture.half;
  const b = reference.half;
  const lab = new Float32Array(6);
  for (let i = 0; i < size; ++i) {
    const [ar, ag, ab] = [a[i]!, a[size + i]!, a[2 * size + i]!];
    const [br, bg, bb] = [b[i]!, b[size + i]!, b[2 * size + i]!];
    if (kind === "lab") {
      labFromRgb(shown[ar]!, shown[ag]!, shown[ab]!, lab, 0);
      labFromRgb(shown[br]!, shown[bg]!, shown[bb]!, lab, 3);
      result[i] = Math.hypot(lab[0]! - lab[3]!, lab[1]! - lab[4]!, lab[2]! - lab[5]!);
    } else if (kind === "luminance") {
      result[i] =
        exposure *
        (luminance(floatOfHalf(ar), floatOfHalf(ag), floatOfHalf(ab)) -
          luminance(floatOfHalf(br), floatOfHalf(bg), floatOfHalf(bb)));
    } else {
      result[i] = (relative(ar, br) + relative(ag, bg) + relative(ab, bb)) / 3;
    }
  }
  return result;
}

function relative(x: number, r: number): number {
  const reference = floatOfHalf(r);
  return (floatOfHalf(x) - reference) ** 2 / (reference * reference + 0.01);
}

export function errorColours(kind: ErrorKind): Uint8ClampedArray {
  return ERRORS[kind].signed ? BLUE_ORANGE : EMBER;
}

/** 8-bit RGBA of an error map whose colours end at `full`. */
export function colourErrors(map: Float32Array, kind: ErrorKind, full: number, out: Uint8ClampedArray): void {
  const colours = errorColours(kind);
  const signed = ERRORS[kind].signed;
  for (let i = 0; i < map.length; ++i) {
    const share = signed ? 0.5 + (0.5 * map[i]!) / full : map[i]! / full;
    const at = 3 * Math.min(255, Math.max(0, Math.round(255 * share)) || 0);
    out[4 * i] = colours[at]!;
    out[4 * i + 1] = colours[at + 1]!;
    out[4 * i + 2] = colours[at + 2]!;
    out[4 * i + 3] = 255;
  }
}

const KEPT_BYTES = 256 << 20;
const KEPT_DIFFERENCES = 8;

export class Library {
  private readonly places = new Map<string, number>();
  private readonly pictures = new Map<number, Picture>();
  private readonly loading = new Set<number>();
  private readonly errors = new WeakMap<Picture, Map<string, Float32Array>>();
  /** Maps of two methods, the latest last. */
  private readonly differences = new Map<string, Float32Array>();
  /** What was drawn, the latest last. */
  private readonly drawn = new Map<string, HTMLCanvasElement>();
  private drawnBytes = 0;

  /**
   * @param changed  called when a picture has become available
   * @param failed   called with what went wrong
   */
  constructor(
    private readonly entries: readonly PictureEntry[],
    private readonly changed: () => void,
    private readonly failed: (what: string) => void,
  ) {
    entries.forEach((entry, i) => this.places.set(`${entry.scene}\n${entry.spp}\n${entry.method}`, i));
  }

  private place(scene: string, spp: number, method: string): number | undefined {
    return this.places.get(`${scene}\n${method === REFERENCE ? 0 : spp}\n${method}`);
  }

  has(scene: string, spp: number, method: string): boolean {
    return this.place(scene, spp, method) !== undefined;
  }

  size(scene: string) {
    return this.entries.find((entry) => entry.scene === scene);
  }

  /** The picture, or nothing yet: then it is fetched, and `changed` called. */
  get(scene: string, spp: number, method: string): Picture | undefined {
    const place = this.place(scene, spp, method);
    if (place === undefined) return undefined;
    if (!this.pictures.has(place) && !this.loading.has(place)) {
      this.loading.add(place);
      this.load(place).then(this.changed, (error: unknown) => this.failed(`picture ${place}: ${String(error)}`));
    }
    return this.pictures.get(place);
  }

  private async load(place: number): Promise<void> {
    const { width, height, data } = this.entries[place]!;
    const element = await embedded(`picture-${data}`);
    const bytes = await inflate(fromBase64(element.textContent ?? ""));
    this.pictures.set(place, new Picture(width, height, unpredict(bytes, width, height)));
  }

  error(kind: ErrorKind, picture: Picture, reference: Picture, exposure: number): Float32Array {
    let maps = this.errors.get(picture);
    if (!maps) this.errors.set(picture, (maps = new Map()));
    const name = `${kind} ${exposure}`;
    let map = maps.get(name);
    if (!map) maps.set(name, (map = errorMap(kind, picture, reference, exposure)));
    return map;
  }

  /** What one picture of a scene differs in from another: from the reference, or from another method's. */
  difference(
    kind: ErrorKind,
    scene: string,
    spp: number,
    method: string,
    base: string,
    exposure: number,
  ): Float32Array | undefined {
    const [picture, other] = [this.get(scene, spp, method), this.get(scene, spp, base)];
    if (!picture || !other) return undefined;
    if (base === REFERENCE) return this.error(kind, picture, other, exposure);
    const name = [kind, exposure, this.place(scene, spp, method), this.place(scene, spp, base)].join(" ");
    const map = this.differences.get(name) ?? errorMap(kind, picture, other, exposure);
    this.differences.delete(name);
    this.differences.set(name, map);
    for (const oldest of this.differences.keys()) {
      if (this.differences.size <= KEPT_DIFFERENCES) break;
      this.differences.delete(oldest);
    }
    return map;
  }

  /** A canvas of the picture's own size. */
  canvas(scene: string, spp: number, method: string, look: Look): HTMLCanvasElement | undefined {
    const picture = this.get(scene, spp, method);
    if (!picture) return undefined;
    const map =
      look.show === "error" ? this.difference(look.kind, scene, spp, method, look.base, look.exposure) : undefined;
    if (look.show === "error" && !map) return undefined;
    const name = `${this.place(scene, spp, method)} ${JSON.stringify(look)}`;
    let canvas = this.drawn.get(name);
    if (canvas) {
      this.drawn.delete(name);
    } else {
      canvas = document.createElement("canvas");
      canvas.width = picture.width;
      canvas.height = picture.height;
      const context = canvas.getContext("2d")!;
      const image = context.createImageData(picture.width, picture.height);
      if (look.show === "error") colourErrors(map!, look.kind, look.full, image.data);
      else colourPicture(picture, look.tone, look.exposure, image.data);
      context.putImageData(image, 0, 0);
      this.drawnBytes += image.data.length;
    }
    this.drawn.set(name, canvas);
    for (const [oldest, old] of this.drawn) {
      if (this.drawnBytes <= KEPT_BYTES || oldest === name) break;
      this.drawn.delete(oldest);
      this.drawnBytes -= 4 * old.width * old.height;
    }
    return canvas;
  }
}

/** An element of the page, which the browser may still be reading. */
async function embedded(id: string): Promise<HTMLElement> {
  const whole = () => {
    const element = document.getElementById(id);
    return element && (document.readyState !== "loading" || element.nextElementSibling) ? element : undefined;
  };
  for (;;) {
    const element = whole();
    if (element) return element;
    if (document.readyState !== "loading") throw new Error(`the page holds no '${id}'`);
    await new Promise((resolve) => setTimeout(resolve, 30));
  }
}
