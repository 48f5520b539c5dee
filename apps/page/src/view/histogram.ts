// How often values occur in a picture.
import { luminance } from "../color";
import { floatOfHalf } from "../half";
import type { LayerPicture } from "./protocol";

/** Pixels that are looked at: enough for the shape of a histogram and a range. */
const ENOUGH = 1 << 16;

/** Luminances, or the values of a layer of one channel, of evenly spread pixels; those not finite are left out. */
export function sampled({ half, width, height, channels }: LayerPicture, enough = ENOUGH): Float32Array {
  const size = width * height;
  const step = Math.max(1, Math.floor(size / enough)) | 1;
  const values = new Float32Array(Math.ceil(size / step));
  let count = 0;
  for (let i = 0; i < size; i += step) {
    const value =
      channels === 1
        ? floatOfHalf(half[i]!)
        : luminance(floatOfHalf(half[i]!), floatOfHalf(half[size + i]!), floatOfHalf(half[2 * size + i]!));
    if (Number.isFinite(value)) values[count++] = value;
  }
  return values.subarray(0, count);
}

/** Shares of the values in equal bins from `low` to `high`; values outside count in the first and last. */
export function histogram(values: ArrayLike<number>, low: number, high: number, bins: number): Float32Array {
  const shares = new Float32Array(bins);
  if (!values.length || !(high > low)) return shares;
  const factor = bins / (high - low);
  for (let i = 0; i < values.length; ++i)
    shares[Math.min(bins - 1, Math.max(0, Math.floor((values[i]! - low) * factor)))]! += 1 / values.length;
  return shares;
}

/** Binary logarithms; values at or below zero are left out. */
export function log2OfPositive(values: Float32Array, factor: number): Float32Array {
  return values.filter((v) => v > 0).map((v) => Math.log2(v * factor));
}

/** Where false colours begin and end: at round numbers around nearly all values. */
export function colourRange(layer: string, values: Float32Array): [low: number, high: number] {
  if (layer === "coverage") return [0, 1];
  if (!values.length) return [0, 1];
  const sorted = values.slice().sort();
  const at = (share: number) => sorted[Math.round(share * (sorted.length - 1))]!;
  const high = at(0.995);
  const low = layer === "depth" ? (sorted.find((v) => v > 0) ?? 0) : Math.min(0, at(0.005));
  return high > low ? [low, high] : [low, low + (Math.abs(low) || 1)];
}
