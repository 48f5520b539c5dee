// Vectors of three numbers, and numbers of them short enough for a command line.

export type Vec3 = readonly [number, number, number];

export const add = (a: Vec3, b: Vec3): Vec3 => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const sub = (a: Vec3, b: Vec3): Vec3 => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const scale = (a: Vec3, s: number): Vec3 => [a[0] * s, a[1] * s, a[2] * s];
export const dot = (a: Vec3, b: Vec3): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a: Vec3, b: Vec3): Vec3 => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];
export const length = (a: Vec3): number => Math.hypot(a[0], a[1], a[2]);
export const normalize = (a: Vec3): Vec3 => {
  const size = length(a);
  return size > 0 ? scale(a, 1 / size) : a;
};

/** A unit vector perpendicular to a unit vector. */
export function perpendicular(n: Vec3): Vec3 {
  return normalize(cross(n, Math.abs(n[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0]));
}

/** `a` turned about the unit vector `axis`, counter-clockwise seen from its tip (Rodrigues). */
export function turned(a: Vec3, axis: Vec3, angle: number): Vec3 {
  const [cos, sin] = [Math.cos(angle), Math.sin(angle)];
  return add(add(scale(a, cos), scale(cross(axis, a), sin)), scale(axis, dot(axis, a) * (1 - cos)));
}

/** A number with a relative precision of 1e-6 of `size`. */
export function rounded(value: number, size: number): number {
  const digits = Math.min(15, Math.max(0, 5 - Math.floor(Math.log10(size > 0 ? size : 1))));
  // Adding zero turns a negative zero into zero.
  return Number(value.toFixed(digits)) + 0;
}

export function roundedVector(v: Vec3, size: number): Vec3 {
  return [rounded(v[0], size), rounded(v[1], size), rounded(v[2], size)];
}
