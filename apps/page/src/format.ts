// Numbers as text.

/** Three or four significant digits, without an exponent where that stays short. */
export function number(value: number | null | undefined): string {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (!Number.isFinite(value)) return value > 0 ? "∞" : "−∞";
  if (size >= 1e5 || size < 1e-4) return minus(value.toExponential(2).replace("e+", "e"));
  return minus(size >= 1000 ? value.toFixed(0) : size >= 1 ? value.toPrecision(4) : value.toPrecision(3));
}

/** How many times. */
export function times(factor: number): string {
  return factor >= 10 ? factor.toFixed(0) : factor.toFixed(1);
}

export function signed(value: number): string {
  return value > 0 ? `+${number(value)}` : number(value);
}

export function percent(share: number): string {
  const value = 100 * share;
  const digits = Math.abs(value) >= 10 ? 0 : 1;
  return `${value > 0 ? "+" : ""}${minus(value.toFixed(digits))} %`;
}

export function seconds(value: number | undefined): string {
  if (value === undefined || value === 0) return "–";
  if (value >= 100) return `${value.toFixed(0)} s`;
  if (value >= 1) return `${value.toFixed(2)} s`;
  return `${(1000 * value).toFixed(value >= 0.01 ? 0 : 1)} ms`;
}

export function bytes(value: number | null | undefined): string {
  if (value === null || value === undefined) return "–";
  if (value >= 2 ** 30) return `${(value / 2 ** 30).toFixed(2)} GiB`;
  if (value >= 2 ** 20) return `${(value / 2 ** 20).toFixed(value >= 10 * 2 ** 20 ? 0 : 1)} MiB`;
  return `${(value / 2 ** 10).toFixed(0)} KiB`;
}

/** Stops of exposure. */
export function stops(value: number): string {
  return `${value > 0 ? "+" : ""}${minus(value.toFixed(2).replace(/0$/, ""))} EV`;
}

/** A name that may be broken after each of its words. */
export function breakable(name: string): string {
  return name.replace(/_/g, "_\u200b");
}

function minus(text: string): string {
  return text.replace("-", "−");
}
