// What drags, wheel and keys do to a scene's camera. Angles are in radians, but fov, which is in degrees as in the scene.
import {
  add,
  cross,
  dot,
  length,
  normalize,
  perpendicular,
  roundedVector,
  rounded,
  scale,
  sub,
  type Vec3,
} from "./vector";

export interface Camera {
  type: "perspective" | "orthographic";
  position: Vec3;
  look_at: Vec3;
  up: Vec3;
  /** Perspective: full angle of view along fov_axis [degrees]. */
  fov: number;
  /** Orthographic: extent of the picture along fov_axis [scene units]. */
  width: number;
  fov_axis: "x" | "y" | "shorter";
  lens_radius: number;
  focus_distance: number;
}

export type Bounds = readonly [Vec3, Vec3];

/** The camera never looks exactly along `up`: the picture's own up would be undefined there. */
const HIGHEST = (89.9 / 180) * Math.PI;

export interface Axes {
  right: Vec3;
  up: Vec3;
  forward: Vec3;
}

export function axes(camera: Camera): Axes {
  const forward = normalize(sub(camera.look_at, camera.position));
  const side = cross(forward, normalize(camera.up));
  const right = length(side) > 1e-9 ? normalize(side) : perpendicular(forward);
  return { right, up: cross(right, forward), forward };
}

export function distance(camera: Camera): number {
  return length(sub(camera.position, camera.look_at));
}

/** Half of the picture's width and height at the depth of look_at [scene units]. @param aspect  width over height */
export function halfExtent(camera: Camera, aspect: number): { x: number; y: number } {
  const alongX = camera.fov_axis === "x" || (camera.fov_axis === "shorter" && aspect <= 1);
  const extent =
    camera.type === "orthographic"
      ? camera.width / 2
      : Math.tan((camera.fov / 360) * Math.PI) * Math.max(distance(camera), 1e-12);
  return alongX ? { x: extent, y: extent / aspect } : { x: extent * aspect, y: extent };
}

/** Position of a camera at an azimuth and elevation about look_at, given as the horizontal direction of azimuth 0. */
function placed(camera: Camera, horizontal: Vec3, elevation: number, far: number): Camera {
  const up = normalize(camera.up);
  const angle = Math.min(Math.max(elevation, -HIGHEST), HIGHEST);
  const offset = add(scale(horizontal, Math.cos(angle) * far), scale(up, Math.sin(angle) * far));
  return { ...camera, position: add(camera.look_at, offset) };
}

/** Turns the camera about look_at: `right` radians to the right around up, `above` radians towards up, never over it. */
export function orbit(camera: Camera, right: number, above: number): Camera {
  const up = normalize(camera.up);
  const offset = sub(camera.position, camera.look_at);
  const far = length(offset);
  if (!(far > 0)) return camera;
  const height = dot(offset, up);
  const flat = sub(offset, scale(up, height));
  const level = length(flat);
  const horizontal = level > 1e-6 * far ? scale(flat, 1 / level) : scale(axes(camera).up, height > 0 ? -1 : 1);
  const side = cross(up, horizontal);
  const turned = add(scale(horizontal, Math.cos(right)), scale(side, Math.sin(right)));
  return placed(camera, normalize(turned), Math.atan2(height, level) + above, far);
}

/** Moves camera and look_at in the picture's plane, by shares of the picture's height at look_at's depth. */
export function pan(camera: Camera, right: number, up: number, aspect: number): Camera {
  const { y } = halfExtent(camera, aspect);
  const a = axes(camera);
  const by = add(scale(a.right, 2 * y * right), scale(a.up, 2 * y * up));
  return { ...camera, position: add(camera.position, by), look_at: add(camera.look_at, by) };
}

/** Multiplies the distance to look_at, or what an orthographic picture spans. */
export function dolly(camera: Camera, factor: number): Camera {
  if (camera.type === "orthographic") return { ...camera, width: Math.max(camera.width * factor, 1e-12) };
  const offset = sub(camera.position, camera.look_at);
  return { ...camera, position: add(camera.look_at, scale(offset, factor)) };
}

/** Multiplies the extent that the angle of view spans. */
export function zoom(camera: Camera, factor: number): Camera {
  if (camera.type === "orthographic") return dolly(camera, factor);
  const fov = (360 / Math.PI) * Math.atan(Math.tan((camera.fov / 360) * Math.PI) * factor);
  return { ...camera, fov: Math.min(Math.max(fov, 0.1), 170) };
}

/** Looks along one of the scene's axes, from the present distance. Front is as a lat-long picture's middle has it: along
 *  +y where up is z, along -z where up is y. */
export function seenFrom(camera: Camera, side: "front" | "side" | "top"): Camera {
  const up = normalize(camera.up);
  const largest = Math.max(...up.map(Math.abs));
  const towards: Vec3 = Math.abs(up[1]) === largest ? [0, 0, 1] : [0, -1, 0];
  const front = normalize(sub(towards, scale(up, dot(towards, up))));
  const far = distance(camera) || 1;
  if (side === "top") return placed(camera, front, Math.PI / 2, far);
  return placed(camera, side === "front" ? front : cross(up, front), 0, far);
}

/** Keeps the direction and shows all of the bounds. */
export function framed(camera: Camera, [low, high]: Bounds, aspect: number): Camera {
  const radius = length(sub(high, low)) / 2;
  if (!(radius > 0) || !Number.isFinite(radius)) return camera;
  const look_at = scale(add(low, high), 0.5);
  const { forward } = axes(camera);
  const away = (far: number): Camera => ({ ...camera, look_at, position: sub(look_at, scale(forward, far)) });
  const { x, y } = halfExtent(camera, aspect);
  const narrower = Math.min(x, y);
  if (camera.type === "orthographic")
    return { ...away(Math.max(distance(camera), 2 * radius)), width: (camera.width * radius) / narrower };
  return away(radius / Math.sin(Math.atan(narrower / Math.max(distance(camera), 1e-12))));
}

/** Looks at a point, which a lens is then focused on. */
export function focusedOn(camera: Camera, point: Vec3): Camera {
  const far = length(sub(point, camera.position));
  if (!(far > 0)) return camera;
  return { ...camera, look_at: point, focus_distance: camera.lens_radius > 0 ? far : camera.focus_distance };
}

/** The point of the plane through look_at that is seen at a place of the picture, 0 to 1 from its left and top. */
export function onFocusPlane(camera: Camera, x: number, y: number, aspect: number): Vec3 {
  const half = halfExtent(camera, aspect);
  const a = axes(camera);
  return add(camera.look_at, add(scale(a.right, (2 * x - 1) * half.x), scale(a.up, (1 - 2 * y) * half.y)));
}

/** The camera in numbers that are no longer than the picture needs. */
export function roundedCamera(camera: Camera): Camera {
  const size = Math.max(distance(camera), 1e-9);
  return {
    ...camera,
    position: roundedVector(camera.position, size),
    look_at: roundedVector(camera.look_at, size),
    fov: rounded(camera.fov, 10),
    width: rounded(camera.width, camera.width),
    focus_distance: rounded(camera.focus_distance, size),
  };
}
