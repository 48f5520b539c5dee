// What keys, buttons and clicks on the picture do, beyond one field.
import { touches, type Value } from "./assignments";
import { axes, focusedOn, framed, onFocusPlane, type Camera } from "./camera";
import { channels } from "./field_info";
import { aboveHorizon, lampAt, sunTurned } from "./lighting";
import type { Viewer } from "./viewer";
import { add, normalize, roundedVector, scale, type Vec3 } from "./vector";

export interface Sun {
  /** The assignment that turns it. */
  key: string;
  title: string;
}

/** What the sun tool can turn: lights of type sun, and the sky's. */
export function suns(viewer: Viewer): Sun[] {
  const lights = viewer.values
    .groups("lights")
    .filter(({ path }) => viewer.value(`${path}.type`) === "sun" && viewer.value(`${path}.enabled`) !== false)
    .map(({ path }) => ({ key: `${path}.direction`, title: viewer.values.title(path) }));
  return ["preetham", "atmosphere"].includes(String(viewer.value("environment.sky")))
    ? [...lights, { key: "environment.sun_direction", title: "sky" }]
    : lights;
}

export function chosenSun(viewer: Viewer): Sun | undefined {
  const all = suns(viewer);
  return all.find(({ key }) => key === viewer.sun) ?? all[0];
}

/** The sun tool; a scene without a sun gets one, from the upper left behind the camera. */
export function toggleSunTool(viewer: Viewer): void {
  if (viewer.tool === "sun") return viewer.use("camera");
  viewer.use("sun");
  const { camera } = viewer;
  if (suns(viewer).length || !camera || !viewer.scene) return;
  const exposure = Number(viewer.value("film.exposure")) || 1;
  const { right, up, forward } = axes(camera);
  const direction = normalize(add(add(scale(right, -0.6), scale(up, 0.7)), scale(forward, -0.5)));
  const sun = {
    type: "sun",
    direction: roundedVector(direction, 1),
    irradiance: [3, 3, 3].map((e) => Number((e / exposure).toPrecision(3))),
  };
  const index = viewer.values.groups("lights").length;
  viewer.assign(`lights.${index}`, sun);
  viewer.say("A sun was added");
}

/** Turns the chosen sun by angles about the camera's axes. */
export function turnSun(viewer: Viewer, right: number, down: number, step: string): void {
  const sun = chosenSun(viewer);
  const { camera } = viewer;
  if (!sun || !camera) return;
  let direction = sunTurned(channels(viewer.value(sun.key)), camera, right, down);
  if (sun.key.startsWith("environment"))
    direction = aboveHorizon(direction, channels(viewer.value("environment.up") ?? [0, 0, 1]));
  viewer.assign(sun.key, direction, step);
}

/** Irradiance of the light that a lamp is to be as strong as [W/m^2]. */
function sunlight(viewer: Viewer): Vec3 {
  for (const { path } of viewer.values.groups("lights"))
    if (viewer.value(`${path}.type`) === "sun" && viewer.value(`${path}.enabled`) !== false) {
      const irradiance = channels(viewer.value(`${path}.irradiance`));
      if (Math.max(...irradiance) > 0) return irradiance;
    }
  const sky = channels(viewer.value("environment.radiance"));
  // A clear sky's sun brings about 100 klux; a constant sky of radiance L the irradiance pi L.
  const sunny = ["preetham", "atmosphere"].includes(String(viewer.value("environment.sky")));
  const factor = sunny ? 100 : Math.PI;
  if (Math.max(...sky) > 0) return sky.map((v) => v * factor) as unknown as Vec3;
  const white = 3 / (Number(viewer.value("film.exposure")) || 1);
  return [white, white, white];
}

/** The point seen at a place of the picture; where nothing is seen, that of the plane through look_at. */
async function pointAt(viewer: Viewer, x: number, y: number, camera: Camera): Promise<Vec3> {
  return (await viewer.probe(x, y)) ?? onFocusPlane(camera, x, y, viewer.aspect);
}

export async function addLamp(viewer: Viewer, x: number, y: number): Promise<void> {
  const { camera, bounds } = viewer;
  viewer.use("camera");
  if (!camera || !bounds) return;
  const lamp = lampAt(await pointAt(viewer, x, y, camera), camera, bounds, sunlight(viewer));
  viewer.assign(`lights.${viewer.values.groups("lights").length}`, lamp as { [key: string]: Value });
  viewer.say("A lamp was added: Ctrl+Z takes it away");
}

/** Looks at what is seen at a place of the picture. */
export async function focusAt(viewer: Viewer, x: number, y: number): Promise<void> {
  if (!viewer.camera) return;
  const point = await viewer.probe(x, y);
  if (point) viewer.moveCamera((camera) => focusedOn(camera, point));
  else viewer.say("There is nothing to look at");
}

export function frameBounds(viewer: Viewer): void {
  const { bounds } = viewer;
  if (bounds) viewer.moveCamera((camera) => framed(camera, bounds, viewer.aspect));
}

/** The camera of the scene's file. */
export function resetCamera(viewer: Viewer): void {
  if (touches(viewer.assignments, "camera")) viewer.reset("camera");
}

/** Whether a light was added by the page, so that it can be taken away. */
export function isAdded(viewer: Viewer, path: string): boolean {
  return viewer.assignments.has(path);
}

/** An orbit, pan or dolly by key: a step of its own unless another follows at once. */
export function moveByKey(viewer: Viewer, change: (camera: Camera) => Camera): void {
  viewer.nudge(() => viewer.moveCamera(change, "key"));
}
