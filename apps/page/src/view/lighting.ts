// Turning a sun by dragging on the picture, and lamps that are placed where the picture is clicked.
import { axes, type Bounds, type Camera } from "./camera";
import {
  add,
  dot,
  length,
  normalize,
  perpendicular,
  roundedVector,
  rounded,
  scale,
  sub,
  turned,
  type Vec3,
} from "./vector";

/** Turns a direction towards a light about the camera's axes, as a ball seen by the camera would turn. */
export function sunTurned(direction: Vec3, camera: Camera, right: number, down: number): Vec3 {
  const { right: x, up: y } = axes(camera);
  return roundedVector(normalize(turned(turned(direction, y, right), x, down)), 1);
}

/** The direction itself, or the nearest one at least a degree above the horizon. */
export function aboveHorizon(direction: Vec3, up: Vec3): Vec3 {
  const n = normalize(up);
  const unit = normalize(direction);
  const lowest = Math.PI / 180;
  const height = dot(unit, n);
  if (height >= Math.sin(lowest)) return unit;
  const flat = sub(unit, scale(n, height));
  const level = length(flat) > 1e-9 ? normalize(flat) : perpendicular(n);
  return roundedVector(add(scale(level, Math.cos(lowest)), scale(n, 1.001 * Math.sin(lowest))), 1);
}

/** A small sphere in front of a point, which lights things half a diagonal away as the given irradiance does. */
export function lampAt(point: Vec3, camera: Camera, bounds: Bounds, irradiance: Vec3) {
  const diagonal = length(sub(bounds[1], bounds[0])) || 1;
  const towards =
    camera.type === "orthographic" ? scale(axes(camera).forward, -1) : normalize(sub(camera.position, point));
  const radius = 0.02 * diagonal;
  // A sphere of radius r has the irradiance pi L (r / d)^2 at the distance d.
  const factor = (0.5 * diagonal) ** 2 / (Math.PI * radius ** 2);
  const strongest = Math.max(...irradiance);
  return {
    type: "sphere",
    position: roundedVector(add(point, scale(towards, 0.1 * diagonal)), diagonal),
    radius: rounded(radius, radius),
    radiance: irradiance.map((e) => rounded(e * factor, strongest * factor)),
  };
}
