import assert from "node:assert/strict";
import test from "node:test";
import {
  asSet,
  assigned,
  dropped,
  lightRemoved,
  lookUp,
  NONE,
  toml,
  touches,
  type Assignments,
  type Value,
} from "../src/view/assignments";
import {
  axes,
  distance,
  dolly,
  focusedOn,
  framed,
  halfExtent,
  onFocusPlane,
  orbit,
  pan,
  roundedCamera,
  seenFrom,
  zoom,
  type Camera,
} from "../src/view/camera";
import {
  channels,
  colourOf,
  hexOf,
  labelOf,
  ordered,
  shortColour,
  sliderPlace,
  sliderRange,
  sliderValue,
  SLIDER_STEPS,
} from "../src/view/field_info";
import { DisplayCube } from "../src/view/display_cube";
import { FrameCache } from "../src/view/frame_cache";
import { colourRange, histogram, log2OfPositive, sampled } from "../src/view/histogram";
import { History } from "../src/view/history";
import { aboveHorizon, lampAt, sunTurned } from "../src/view/lighting";
import { decodePicture, type Field, type LayerPicture, type SceneMessage } from "../src/view/protocol";
import { secondsLeft, timeText } from "../src/view/progress";
import { SceneValues } from "../src/view/scene_values";
import { pictureSize } from "../src/view/settings";
import { dot, length, normalize, rounded, sub, type Vec3 } from "../src/view/vector";
import { toHalf } from "./fixture";

const CAMERA: Camera = {
  type: "perspective",
  position: [0, -6, 1],
  look_at: [0, 0, 1],
  up: [0, 0, 1],
  fov: 40,
  width: 3,
  fov_axis: "x",
  lens_radius: 0,
  focus_distance: 0,
};

function near(found: readonly number[], expected: readonly number[], tolerance = 1e-9): void {
  assert.equal(found.length, expected.length);
  found.forEach((v, i) => assert.ok(Math.abs(v - expected[i]!) <= tolerance, `${found} is not ${expected}`));
}

/** Where a point is seen, 0 to 1 from the picture's left and top. */
function seenAt(camera: Camera, point: Vec3, aspect: number): [number, number] {
  const a = axes(camera);
  const offset = sub(point, camera.position);
  const half = halfExtent(camera, aspect);
  const depth = camera.type === "orthographic" ? 1 : dot(offset, a.forward) / distance(camera);
  return [0.5 + dot(offset, a.right) / depth / half.x / 2, 0.5 - dot(offset, a.up) / depth / half.y / 2];
}

test("an orbit keeps the distance and turns to the right and up by the angles", () => {
  const quarter = orbit(CAMERA, Math.PI / 2, 0);
  near(quarter.position, [6, 0, 1]);
  const above = orbit(CAMERA, 0, Math.PI / 6);
  near(above.position, [0, -6 * Math.cos(Math.PI / 6), 1 + 3]);
  assert.ok(Math.abs(distance(orbit(above, 0.7, -0.3)) - 6) < 1e-12);
});

test("an orbit never goes over a pole, for any up axis", () => {
  for (const up of [
    [0, 0, 1],
    [0, 1, 0],
    [1, 0, 0],
    [0, 0, -2],
    [0.3, -0.4, 0.8],
  ] as Vec3[]) {
    let camera: Camera = { ...CAMERA, up };
    const before = axes(orbit(camera, 0, 0)).right;
    for (let i = 0; i < 50; ++i) camera = orbit(camera, 0, 0.2);
    const { right, up: seen } = axes(camera);
    near(right, before, 1e-6);
    assert.ok(dot(seen, normalize(up)) > 0, "the picture stands on its head");
    camera = orbit(camera, 0, -1);
    assert.ok(dot(axes(camera).up, normalize(up)) > 0.5);
  }
});

test("a pan by a share of the height moves look_at's picture by it", () => {
  for (const type of ["perspective", "orthographic"] as const)
    for (const [fov_axis, aspect] of [
      ["x", 1.6],
      ["y", 1.6],
      ["shorter", 0.7],
    ] as const) {
      const camera: Camera = { ...CAMERA, type, fov_axis };
      const moved = pan(camera, -0.1, 0.2, aspect);
      // The point drags to the right and down: by shares of the height on both axes.
      near(seenAt(moved, camera.look_at, aspect), [0.5 + 0.1 / aspect, 0.5 + 0.2]);
    }
});

test("a dolly changes the distance, or an orthographic camera's width, and leaves look_at", () => {
  const closer = dolly(CAMERA, 0.5);
  near(closer.position, [0, -3, 1]);
  assert.equal(closer.look_at, CAMERA.look_at);
  const parallel: Camera = { ...CAMERA, type: "orthographic" };
  assert.equal(dolly(parallel, 0.5).width, 1.5);
  assert.equal(dolly(parallel, 0.5).position, parallel.position);
  const wider = zoom(CAMERA, 2);
  assert.ok(Math.abs(Math.tan((wider.fov * Math.PI) / 360) - 2 * Math.tan((40 * Math.PI) / 360)) < 1e-12);
});

test("front, side and top respect the up axis", () => {
  near(axes(seenFrom(CAMERA, "front")).forward, [0, 1, 0], 1e-12);
  near(axes(seenFrom(CAMERA, "side")).forward, [-1, 0, 0], 1e-12);
  near(axes(seenFrom(CAMERA, "top")).forward, [0, 0, -1], 0.01);
  near(axes(seenFrom(CAMERA, "top")).up, [0, 1, 0], 0.01);
  const y: Camera = { ...CAMERA, up: [0, 1, 0] };
  near(axes(seenFrom(y, "front")).forward, [0, 0, -1], 1e-12);
  near(axes(seenFrom(y, "side")).forward, [-1, 0, 0], 1e-12);
  near(axes(seenFrom(y, "top")).forward, [0, -1, 0], 0.01);
  for (const side of ["front", "side", "top"] as const)
    assert.ok(Math.abs(distance(seenFrom(y, side)) - distance(y)) < 1e-9);
});

test("framing shows all corners of the bounds from the same direction", () => {
  const bounds = [
    [-2, -1, 0],
    [4, 3, 1],
  ] as const;
  for (const type of ["perspective", "orthographic"] as const)
    for (const aspect of [0.5, 1, 2.4]) {
      const camera = framed({ ...CAMERA, type }, bounds, aspect);
      near(axes(camera).forward, axes(CAMERA).forward, 1e-12);
      for (let corner = 0; corner < 8; ++corner) {
        const point = [0, 1, 2].map((i) => bounds[(corner >> i) & 1]![i]!) as unknown as Vec3;
        for (const place of seenAt(camera, point, aspect)) assert.ok(place >= 0 && place <= 1, `seen at ${place}`);
      }
    }
});

test("a double click looks at the point and focuses a lens on it", () => {
  const point: Vec3 = [1, -1, 2];
  assert.deepEqual(focusedOn(CAMERA, point).look_at, point);
  assert.equal(focusedOn(CAMERA, point).focus_distance, 0);
  const lens = focusedOn({ ...CAMERA, lens_radius: 0.1, focus_distance: 2 }, point);
  assert.ok(Math.abs(lens.focus_distance - length(sub(point, CAMERA.position))) < 1e-12);
});

test("a place of the picture lies on the plane through look_at where it is seen", () => {
  const camera = orbit(CAMERA, 0.4, 0.3);
  near(seenAt(camera, onFocusPlane(camera, 0.2, 0.9, 1.5), 1.5), [0.2, 0.9]);
});

test("numbers are as short as a picture allows", () => {
  assert.equal(rounded(1 / 3, 1), 0.33333);
  assert.equal(rounded(1234.56789, 6), 1234.56789);
  assert.ok(Object.is(rounded(-1e-9, 1), 0));
  assert.deepEqual(roundedCamera({ ...CAMERA, position: [1e-9, -6.1234567, 1] }).position, [0, -6.12346, 1]);
});

test("a sun turns as a ball seen by the camera", () => {
  // From behind the camera, a drag to the right brings it to the right, one upwards brings it up.
  near(sunTurned([0, -1, 0], CAMERA, Math.PI / 2, 0), [1, 0, 0], 1e-5);
  near(sunTurned([0, -1, 0], CAMERA, 0, -Math.PI / 2), [0, 0, 1], 1e-5);
  assert.ok(Math.abs(length(sunTurned([3, 4, 5], CAMERA, 0.3, 0.2)) - 1) < 1e-4);
});

test("the sky's sun stays above the horizon", () => {
  for (const up of [
    [0, 0, 1],
    [0, 1, 0],
  ] as Vec3[]) {
    assert.ok(dot(aboveHorizon([1, -1, -1], up), up) >= Math.sin(Math.PI / 180) - 1e-5);
    near(aboveHorizon([1, 1, 1], up), normalize([1, 1, 1]), 1e-12);
  }
  assert.ok(dot(aboveHorizon([0, 0, -1], [0, 0, 1]), [0, 0, 1]) > 0);
});

test("a lamp stands in front of the point and lights as strongly as the sun half a diagonal away", () => {
  const bounds = [
    [-1, -1, -1],
    [1, 1, 1],
  ] as const;
  const diagonal = Math.sqrt(12);
  const lamp = lampAt([0, 0, 1], CAMERA, bounds, [3, 2, 1]);
  near(lamp.position, [0, -0.1 * diagonal, 1], 1e-4);
  assert.ok(Math.abs(lamp.radius - 0.02 * diagonal) < 1e-6);
  const irradiance = lamp.radiance.map((L) => Math.PI * L * (lamp.radius / (0.5 * diagonal)) ** 2);
  near(irradiance, [3, 2, 1], 1e-3);
});

test("assignments are written as the program's option -D takes them", () => {
  let all: Assignments = NONE;
  all = assigned(all, "camera.position", [0, -6, 1.5]);
  all = assigned(all, "volumes.0.enabled", false);
  all = assigned(all, "environment.sky", 'a "b"');
  all = assigned(all, "lights.1", { type: "sphere", position: [0, 0, 2], radius: 0.1 });
  all = assigned(all, "lights.1.radius", 0.2);
  assert.deepEqual(asSet(all), [
    "camera.position=[0,-6,1.5]",
    "volumes.0.enabled=false",
    'environment.sky="a \\"b\\""',
    'lights.1={type="sphere",position=[0,0,2],radius=0.1}',
    "lights.1.radius=0.2",
  ]);
  assert.equal(toml(1e21), "1e21");
  assert.equal(lookUp(all, "lights.1.radius"), 0.2);
  assert.deepEqual(lookUp(all, "lights.1.position"), [0, 0, 2]);
  assert.equal(lookUp(all, "lights.0.radius"), undefined);
  assert.ok(touches(all, "camera") && !touches(all, "film"));
  assert.ok(!touches(assigned(NONE, "lights.10.radius", 1), "lights.1"));
});

test("resetting a field drops its assignment, and that of a table all in it", () => {
  const all: Assignments = new Map<string, Value>([
    ["lights.1", 1],
    ["lights.1.radius", 2],
    ["lights.10.radius", 3],
  ]);
  assert.deepEqual([...dropped(all, "lights.1").keys()], ["lights.10.radius"]);
  assert.deepEqual([...dropped(all, "lights.1.radius").keys()], ["lights.1", "lights.10.radius"]);
});

test("lights after one that is taken away move up", () => {
  const all: Assignments = new Map<string, Value>([
    ["lights.0.enabled", false],
    ["lights.1", "first"],
    ["lights.1.radius", 1],
    ["lights.2", "second"],
    ["lights.2.radius", 2],
  ]);
  assert.deepEqual(
    [...lightRemoved(all, 1)],
    [
      ["lights.0.enabled", false],
      ["lights.1", "second"],
      ["lights.1.radius", 2],
    ],
  );
});

test("a drag is one step of undo", () => {
  const history = new History(0);
  history.change(1, "drag 1");
  history.change(2, "drag 1");
  history.change(3, "drag 1");
  history.endStep();
  history.change(4, "drag 1");
  history.change(5);
  history.change(6);
  const back: number[] = [];
  while (history.canUndo) {
    history.undo();
    back.push(history.now);
  }
  assert.deepEqual(back, [5, 4, 3, 0]);
  history.redo();
  assert.equal(history.now, 3);
  history.change(9);
  assert.ok(!history.canRedo);
  history.undo();
  assert.equal(history.now, 3);
});

test("the file's values come back when an assignment is dropped", () => {
  const message = (id: number, fov: number): SceneMessage => ({
    type: "scene",
    id,
    name: "",
    layers: [],
    groups: [{ path: "camera", title: "camera", fields: [{ key: "fov", type: "number", value: fov }] }],
  });
  const values = new SceneValues();
  const changed = assigned(NONE, "camera.fov", 20);
  values.take(message(1, 33), NONE);
  assert.equal(values.value(changed, "camera.fov"), 20);
  values.take(message(2, 20), changed);
  assert.equal(values.value(NONE, "camera.fov"), 33);
  // The file has changed meanwhile.
  values.take({ ...message(3, 50), reloaded: true }, NONE);
  assert.equal(values.value(NONE, "camera.fov"), 50);
});

function packed(header: object, halves: number[]): ArrayBuffer {
  const text = JSON.stringify(header);
  const padded = text.padEnd(4 * Math.ceil(text.length / 4));
  const buffer = new ArrayBuffer(4 + padded.length + 2 * halves.length);
  new DataView(buffer).setUint32(0, padded.length, true);
  new Uint8Array(buffer).set(new TextEncoder().encode(padded), 4);
  new Uint16Array(buffer, 4 + padded.length).set(halves);
  return buffer;
}

test("a picture is decoded, and refused where its size is not its bytes'", () => {
  const halves = [1, 2, 3, 4, 5, 0x3c00];
  const picture = decodePicture(packed({ id: 7, layer: "höhe", width: 2, height: 1, channels: 3 }, halves));
  assert.equal(picture.layer, "höhe");
  assert.deepEqual([...picture.half], halves);
  const header = { id: 7, layer: "depth", width: 2, height: 2, channels: 1 };
  assert.throws(() => decodePicture(packed(header, halves)), /2 x 2 x 1 cannot have 12 bytes/);
  assert.throws(() => decodePicture(packed(header, halves).slice(0, 20)), /with a header of/);
  assert.throws(() => decodePicture(new ArrayBuffer(2)), /2 bytes/);
});

const layer = (name: string, channels: number, values: number[]): LayerPicture => ({
  id: 1,
  layer: name,
  width: values.length / channels,
  height: 1,
  channels,
  stage: "clean",
  full: true,
  samples: 1,
  error: null,
  seconds: 0,
  exposure: 1,
  frame: null,
  half: Uint16Array.from(values, toHalf),
});

test("a histogram counts shares of luminance, the outside in the ends", () => {
  const values = sampled(layer("picture", 3, [1, 0.25, 0, 1, 0.25, 0, 1, 0.25, 0]));
  near([...values], [1, 0.25, 0], 1e-6);
  near([...log2OfPositive(values, 2)], [1, -1], 1e-6);
  assert.deepEqual(
    [...histogram([-5, 0.5, 1.5, 1.6, 9], 0, 4, 4)].map((v) => Math.round(10 * v)),
    [4, 4, 0, 2],
  );
  assert.deepEqual([...histogram([], 0, 1, 2)], [0, 0]);
});

test("false colours span nearly all values", () => {
  assert.deepEqual(colourRange("coverage", sampled(layer("coverage", 1, [0.2, 0.4]))), [0, 1]);
  const [low, high] = colourRange("depth", sampled(layer("depth", 1, [0, 4, 6, Infinity])));
  near([low, high], [4, 6]);
  near(colourRange("clean_error", sampled(layer("clean_error", 1, [0.5, 0.5]))), [0, 0.5]);
  assert.deepEqual(colourRange("samples", new Float32Array()), [0, 1]);
});

test("frames are cached up to a limit, the longest unseen go first", () => {
  const picture = layer("picture", 1, [1, 2, 3, 4]);
  const cache = new FrameCache(3 * picture.half.byteLength);
  for (const frame of [1, 2, 3]) cache.put(frame, picture);
  assert.ok(cache.get(1, ["picture"]));
  cache.put(4, picture);
  assert.equal(cache.get(2, ["picture"]), undefined);
  assert.ok(cache.get(1, ["picture"]) && cache.get(3, ["picture"]) && cache.get(4, ["picture"]));
  assert.equal(cache.get(1, ["picture", "noisy"]), undefined);
  cache.put(1, picture);
  assert.equal(cache.count, 3);
  cache.clear();
  assert.equal(cache.get(4, ["picture"]), undefined);
});

test("the picture's size follows the window and its pixels", () => {
  const window = { width: 1600, height: 800 };
  assert.deepEqual(pictureSize(window, 1, 0), [1280, 640]);
  assert.deepEqual(pictureSize(window, 2, 0.5), [1600, 800]);
  assert.deepEqual(pictureSize(window, 1, 2), [3200, 1600]);
  assert.deepEqual(pictureSize({ width: 300, height: 500 }, 1, 0), [300, 500]);
  assert.deepEqual(pictureSize({ width: 3, height: 5 }, 1, 1), [16, 16]);
});

const field = (key: string, type: Field["type"], more: Partial<Field> = {}): Field => ({
  key,
  type,
  value: 0,
  ...more,
});

test("sliders go where numbers are used, and come back to their values", () => {
  const sigma = sliderRange(field("sigma_t", "color", { lowest: 0 }), 40)!;
  assert.deepEqual(sigma, { lowest: 2, highest: 800, log: true });
  assert.equal(sliderValue(sigma, 0), 0);
  assert.equal(sliderPlace(sigma, 0), 0);
  const g = sliderRange(field("g", "number", { lowest: -0.999, highest: 0.999 }), 0)!;
  assert.deepEqual(g, { lowest: -0.999, highest: 0.999, log: false });
  assert.equal(sliderValue(g, SLIDER_STEPS), 0.999);
  // One that has been set beyond is reached, and the file's value too.
  assert.deepEqual(sliderRange(field("sigma_t", "color", { lowest: 0 }), 40, 1e4), { lowest: 2, highest: 2e4, log: true });
  assert.deepEqual(sliderRange(field("sigma_t", "color", { lowest: 0 }), 40, 0.1), { lowest: 0.05, highest: 800, log: true });
  assert.equal(sliderRange(field("ior", "number", { lowest: 1, highest: 1e9 }), 1.5)!.lowest, 1);
  for (const [range, value] of [
    [sigma, 40],
    [g, 0.6],
  ] as const)
    assert.ok(Math.abs(sliderValue(range, sliderPlace(range, value)) / value - 1) < 0.001);
  assert.equal(sliderRange(field("temperature_offset", "number"), 0), undefined);
});

test("keys are called by words", () => {
  assert.equal(labelOf("sigma_t"), "extinction");
  assert.equal(labelOf("g"), "anisotropy");
  assert.equal(labelOf("some_new_key"), "some new key");
});

test("what is left is told when it can be known", () => {
  assert.equal(secondsLeft({ began: 0, share: 0 }, 0.5, 900), undefined);
  assert.equal(secondsLeft({ began: 0, share: 0 }, 0.01, 5000), undefined);
  assert.equal(secondsLeft({ began: 1000, share: 0 }, 0.25, 4000), 9);
  // A stage of which half was done when it was first told.
  assert.equal(secondsLeft({ began: 0, share: 0.5 }, 0.75, 2000), 2);
  assert.equal(secondsLeft({ began: 0, share: 0 }, 1, 5000), undefined);
  assert.deepEqual([0.34, 12.4, 59.96, 125, 3700].map(timeText), ["0.3 s", "12 s", "1 min 00 s", "2 min 05 s", "1 h 01 min"]);
});

test("a colour is strength times colour", () => {
  assert.equal(hexOf([40, 20, 0]), "#ffbc00");
  near(colourOf("#ffbc00"), [1, 0.5, 0], 5e-3);
  assert.equal(hexOf([0, 0, 0]), "#ffffff");
  assert.deepEqual(colourOf("#000000"), [1, 1, 1]);
  assert.equal(shortColour([40, 40, 40]), 40);
  assert.deepEqual(shortColour([1 / 3, 0.2, 0]), [0.33333, 0.2, 0]);
  assert.deepEqual(channels(3), [3, 3, 3]);
  assert.deepEqual(channels([3]), [3, 3, 3]);
});

test("the fields that a light's type uses come first, those fixed or unused under more", () => {
  const fields = ["enabled", "type", "direction", "irradiance", "position", "radius"].map((key) =>
    field(key, "number", key === "type" ? { fixed: true } : {}),
  );
  const of = (type: string) => ordered("lights.0", fields, (key) => (key === "type" ? type : 0));
  assert.deepEqual(
    of("sun").main.map((f) => f.key),
    ["direction", "irradiance"],
  );
  assert.deepEqual(
    of("sun").more.map((f) => f.key),
    ["type", "position", "radius"],
  );
  assert.deepEqual(
    of("sphere").main.map((f) => f.key),
    ["position", "radius"],
  );
});

test("a display's cube has the program's values at its nodes, and between them where it is linear", () => {
  const side = 5;
  // 0, 1/4, 1/2, 1, 2: the display shows a quarter of red, half of green, a quarter of blue and an eighth of red.
  const edge = [0, 0.25, 0.5, 1, 2];
  const values: number[] = [];
  for (const b of edge)
    for (const g of edge) for (const r of edge) values.push(r / 4, g / 2, b / 4 + r / 8);
  const header = new TextEncoder().encode(JSON.stringify({ name: "sRGB, Filmic", side, lowest: -2, per_stop: 1 }));
  const bytes = new Uint8Array(4 + header.length + 2 * values.length);
  new DataView(bytes.buffer).setUint32(0, header.length, true);
  bytes.set(header, 4);
  const codes = Uint16Array.from(values, (v) => Math.round(65535 * v));
  bytes.set(new Uint8Array(codes.buffer), 4 + header.length);
  const cube = DisplayCube.decode(bytes.buffer);
  assert.equal(cube.name, "sRGB, Filmic");
  assert.throws(() => DisplayCube.decode(bytes.buffer.slice(0, -2)), /5 nodes cannot have 374 values/);

  const shown = (rgb: number[], exposure = 1) => {
    const out = new Uint8ClampedArray(4);
    const half = (v: number) => (Number.isNaN(v) ? 0x7e00 : v === Infinity ? 0x7c00 : toHalf(v));
    cube.colour(Uint16Array.from(rgb, half), exposure, out);
    return [...out];
  };
  const expected = (r: number, g: number, b: number) => [
    ...[r / 4, g / 2, b / 4 + r / 8].map((v) => Math.round(255 * Math.min(1, Math.max(0, v)))),
    255,
  ];
  assert.deepEqual(shown([1, 0.5, 2]), expected(1, 0.5, 2));
  assert.deepEqual(shown([0.5, 0.25, 1], 2), expected(1, 0.5, 2));
  assert.deepEqual(shown([0.125, 0.0625, 0.1875]), expected(0.125, 0.0625, 0.1875)); // in the first, linear cell
  assert.deepEqual(shown([5, 9, 7]), expected(2, 2, 2)); // beyond the last node
  assert.deepEqual(shown([-1, 0, 0]), [0, 0, 0, 255]);
  assert.deepEqual(shown([1, NaN, 1]), [255, 0, 255, 255]);
  assert.deepEqual(shown([1, Infinity, 1]), [255, 0, 255, 255]);
  // All six orders of the places in a cell: what is a sum of the channels is interpolated exactly.
  for (const [r, g, b] of [[1, 2, 3], [1, 3, 2], [2, 1, 3], [2, 3, 1], [3, 1, 2], [3, 2, 1], [2, 2, 1], [1, 2, 2]] as const) {
    const [x, y, z] = [r, g, b].map((v) => v / 16) as [number, number, number];
    assert.deepEqual(shown([x, y, z]), expected(x, y, z));
  }
});
