import type { LayerPicture } from "./protocol";

/** The pictures of a sequence's frames for one state of the scene; those not seen for longest go first. */
export class FrameCache {
  private readonly frames = new Map<number, Map<string, LayerPicture>>();
  private size = 0;

  constructor(private readonly limit = 512 << 20) {}

  put(frame: number, picture: LayerPicture): void {
    const layers = this.frames.get(frame) ?? new Map<string, LayerPicture>();
    this.size += picture.half.byteLength - (layers.get(picture.layer)?.half.byteLength ?? 0);
    layers.set(picture.layer, picture);
    this.touch(frame, layers);
    for (const [oldest, pictures] of this.frames) {
      if (this.size <= this.limit || oldest === frame) break;
      this.frames.delete(oldest);
      for (const { half } of pictures.values()) this.size -= half.byteLength;
    }
  }

  /** The pictures of all these layers, or nothing. */
  get(frame: number, layers: readonly string[]): LayerPicture[] | undefined {
    const pictures = this.frames.get(frame);
    if (!pictures || !layers.every((layer) => pictures.has(layer))) return undefined;
    this.touch(frame, pictures);
    return layers.map((layer) => pictures.get(layer)!);
  }

  clear(): void {
    this.frames.clear();
    this.size = 0;
  }

  get count(): number {
    return this.frames.size;
  }

  private touch(frame: number, pictures: Map<string, LayerPicture>): void {
    this.frames.delete(frame);
    this.frames.set(frame, pictures);
  }
}
