// Who beats whom, as evaluate/metrics/statistics.cpp decides it for the pairs of results.json.

/** How likely Student's t stays within ±t. Source: Abramowitz and Stegun, 26.7.3 and 26.7.4. */
export function studentWithin(t: number, degrees: number): number {
  const angle = Math.atan(Math.abs(t) / Math.sqrt(degrees));
  const [sine, cosine] = [Math.sin(angle), Math.cos(angle)];
  const odd = degrees % 2;
  let term = odd ? cosine : 1;
  let sum = degrees > 1 ? term : 0;
  for (let k = odd + 2; k < degrees; k += 2) sum += term *= (cosine * cosine * (k - 1)) / k;
  return odd ? (2 / Math.PI) * (angle + sine * sum) : sine * sum;
}

const quantiles = new Map<number, number>();

/** The t that Student's stays within 95 times of 100. */
export function studentQuantile(degrees: number): number {
  const known = quantiles.get(degrees);
  if (known !== undefined) return known;
  let [low, high] = [0, 16];
  for (let i = 0; i < 60; ++i) {
    const middle = (low + high) / 2;
    if (studentWithin(middle, degrees) < 0.95) low = middle;
    else high = middle;
  }
  quantiles.set(degrees, high);
  return high;
}

export interface PairedDifference {
  mean: number;
  /** Of a 95 % interval. */
  halfWidth: number;
  /** Of a difference this far from zero where there is none in truth. */
  p: number;
}

/** Of the same seeds, a - b; two at least. */
export function pairedDifference(a: number[], b: number[]): PairedDifference {
  const differences = a.map((value, i) => value - b[i]!);
  const n = differences.length;
  const mean = differences.reduce((sum, d) => sum + d, 0) / n;
  const deviation = Math.sqrt(differences.reduce((sum, d) => sum + (d - mean) ** 2, 0) / (n - 1) / n);
  const p = deviation > 0 ? 1 - studentWithin(mean / deviation, n - 1) : mean === 0 ? 1 : 0;
  return { mean, halfWidth: studentQuantile(n - 1) * deviation, p };
}

/** Which of several p-values are significant together, at 5 % for any of them. Source: Holm 1979. */
export function holmSignificant(p: number[]): boolean[] {
  const order = p.map((_, i) => i).sort((x, y) => p[x]! - p[y]!);
  const significant = p.map(() => false);
  for (const [i, which] of order.entries()) {
    if (p[which]! > 0.05 / (order.length - i)) break;
    significant[which] = true;
  }
  return significant;
}
