// Logarithmic axes, and what is drawn on them.

export interface Point {
  x: number;
  y: number;
  low: number;
  high: number;
  spp: number;
  /** On the Pareto front: nothing else is both faster and better. */
  front: boolean;
}

export interface Line {
  id: string;
  name: string;
  points: Point[];
}

/** The ends of an axis for values, with some room. */
export function spread(values: readonly number[]): [number, number] {
  const positive = values.filter((v) => v > 0);
  const [low, high] = [Math.min(...positive), Math.max(...positive)];
  return positive.length ? [low / 1.25, high * 1.25] : [0.1, 1];
}

/** 1, 2 and 5 of each decade; every decade's 1 where there are many, and more between where there is hardly one. */
export function logTicks(low: number, high: number): number[] {
  const all: number[] = [];
  const decades = Math.log10(high / low);
  for (let d = Math.floor(Math.log10(low)); d <= Math.ceil(Math.log10(high)); ++d)
    for (const m of decades > 3.5 ? [1] : decades > 1.4 ? [1, 2, 5] : [1, 1.5, 2, 3, 4, 6, 8]) {
      const value = m * 10 ** d;
      if (value >= low && value <= high) all.push(value);
    }
  return all;
}

/** A tick's number. */
export function plainTick(value: number): string {
  return value >= 1e5 || value < 1e-4
    ? value.toExponential(0).replace("e+", "e")
    : String(Number(value.toPrecision(3)));
}
