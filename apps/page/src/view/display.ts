// How a layer's pixels get their colours.
import { EMBER } from "../color";
import { tableOfHalf } from "../half";
import { colourPicture, Picture } from "../picture";
import type { DisplayCube } from "./display_cube";
import { colourRange, sampled } from "./histogram";
import type { LayerPicture } from "./protocol";
import type { ViewTone } from "./settings";

export interface Colours {
  tone: ViewTone;
  /** Beside the scene's own exposure. */
  stops: number;
}

/** The picture on a canvas of its own size, drawn again only where its colours change. */
export class Drawn {
  readonly canvas = document.createElement("canvas");
  /** Ends of the false colours of a layer of one channel. */
  readonly range: [number, number];
  /** Luminances or values of evenly spread pixels. */
  readonly values: Float32Array;
  private look = "";

  constructor(readonly picture: LayerPicture) {
    this.values = sampled(picture);
    this.range = picture.channels === 1 ? colourRange(picture.layer, this.values) : [0, 1];
  }

  /** @param cube  of the tone "display" */
  with({ tone, stops }: Colours, cube?: DisplayCube): HTMLCanvasElement {
    const { width, height, channels, half, exposure } = this.picture;
    const look = channels === 1 ? "false colours" : `${tone} ${stops}`;
    if (look === this.look) return this.canvas;
    this.look = look;
    this.canvas.width = width;
    this.canvas.height = height;
    const context = this.canvas.getContext("2d")!;
    const image = context.createImageData(width, height);
    if (channels === 1) colourValues(half, this.range, image.data);
    else if (tone !== "display") colourPicture(new Picture(width, height, half), tone, exposure * 2 ** stops, image.data);
    else cube?.colour(half, exposure * 2 ** stops, image.data);
    context.putImageData(image, 0, 0);
    return this.canvas;
  }
}

/** 8-bit RGBA in false colours; values that are not finite are grey. */
export function colourValues(half: Uint16Array, [low, high]: readonly [number, number], out: Uint8ClampedArray): void {
  const place = tableOfHalf(new Int16Array(65536), (v) =>
    Number.isFinite(v) ? Math.round(255 * Math.min(1, Math.max(0, (v - low) / (high - low)))) : -1,
  );
  for (let i = 0; i < half.length; ++i) {
    const at = place[half[i]!]!;
    for (let c = 0; c < 3; ++c) out[4 * i + c] = at < 0 ? 70 : EMBER[3 * at + c]!;
    out[4 * i + 3] = 255;
  }
}
