import assert from "node:assert/strict";
import test from "node:test";
import { answers, noisyReferences, together } from "../src/answer";
import { BLUE_ORANGE, EMBER, filmicShoulder, labFromRgb, srgbEncode, toneMap } from "../src/color";
import { csv, plotSvg } from "../src/figure";
import { bytes, number, percent, stops } from "../src/format";
import { floatOfHalf, fromBase64, inflate, unpredict } from "../src/half";
import { colourErrors, errorMap, Library } from "../src/library";
import { colourPicture, Picture } from "../src/picture";
import { lines } from "../src/plots";
import { logTicks } from "../src/scales";
import { complete, Index, listed } from "../src/results";
import { defaultView, fromHash, listedMethods, measuredMethods, nearest, toHash, type View } from "../src/state";
import { contained, fitScale, movedBy, pixelAt, transform, WHOLE, zoomedAt } from "../src/viewport";
import { fixture, pack, toHalf } from "./fixture";

const { results, pictures } = fixture();
const index = new Index(results);
const library = new Library(
  pictures,
  () => {},
  () => {},
);

test("a half's bits become its value", () => {
  for (const [bits, value] of [
    [0x3c00, 1],
    [0xc000, -2],
    [0x7bff, 65504],
    [0x0001, 2 ** -24],
    [0x0400, 2 ** -14],
    [0x7c00, Infinity],
    [0x0000, 0],
  ] as const)
    assert.equal(floatOfHalf(bits), value);
  assert.ok(Number.isNaN(floatOfHalf(0x7e00)));
});

test("a packed picture comes back bit for bit", async () => {
  for (const [width, height] of [
    [1, 1],
    [7, 1],
    [1, 5],
    [13, 9],
  ] as const) {
    let state = 1;
    // All kinds of bits: infinities, NaN, both zeros, subnormal numbers.
    const half = Uint16Array.from(
      { length: 3 * width * height },
      () => (state = (Math.imul(state, 75) + 74) % 65537) & 0xffff,
    );
    const text = pack(half, width, height).toString("base64");
    assert.deepEqual(unpredict(await inflate(fromBase64(text)), width, height), half);
  }
});

test("a picture of another size than its bytes is refused", () => {
  assert.throws(() => unpredict(new Uint8Array(5), 1, 1), /1 x 1 cannot have 5 bytes/);
});

test("Lab of white, black and red is that of the standard", () => {
  const lab = new Float32Array(3);
  const of = (r: number, g: number, b: number) => (labFromRgb(r, g, b, lab, 0), [...lab]);
  const near = (found: number[], expected: number[]) =>
    found.forEach((v, i) => assert.ok(Math.abs(v - expected[i]!) < 0.02, `${found} is not ${expected}`));
  near(of(1, 1, 1), [100, 0, 0]);
  near(of(0, 0, 0), [0, 0, 0]);
  near(of(1, 0, 0), [53.24, 80.09, 67.2]);
});

test("tone curves clip, bend or count stops", () => {
  assert.ok(Math.abs(toneMap("srgb", 3) - 1) < 1e-12);
  assert.ok(Math.abs(srgbEncode(0.5) - 0.7354) < 1e-4);
  assert.equal(filmicShoulder(0.1), 0.1);
  assert.ok(toneMap("filmic", 3) < 1 && toneMap("filmic", 3) > toneMap("filmic", 1));
  assert.ok(Math.abs(toneMap("log", 2) - toneMap("log", 1) - 1 / 12) < 1e-12);
  assert.equal(toneMap("log", 0), 0);
  for (const tone of ["srgb", "filmic", "log"] as const) assert.ok(toneMap(tone, -1) === 0);
});

test("the colours of errors grow lighter from end to end, those of signed ones away from the middle", () => {
  const light = (map: Uint8ClampedArray, i: number) =>
    0.2126 * map[3 * i]! + 0.7152 * map[3 * i + 1]! + 0.0722 * map[3 * i + 2]!;
  for (let i = 4; i < 256; i += 4) assert.ok(light(EMBER, i) > light(EMBER, i - 4), `ember at ${i}`);
  for (let i = 4; i < 126; i += 4) assert.ok(light(BLUE_ORANGE, i) < light(BLUE_ORANGE, i - 4), `below zero at ${i}`);
  for (let i = 132; i < 256; i += 4) assert.ok(light(BLUE_ORANGE, i) > light(BLUE_ORANGE, i - 4), `above zero at ${i}`);
});

test("error maps are zero on equal pictures and what the formulas say on others", () => {
  const flat = (value: number) => new Picture(1, 1, Uint16Array.from([value, value, value].map(toHalf)));
  for (const kind of ["lab", "luminance", "relative"] as const)
    assert.equal(errorMap(kind, flat(0.5), flat(0.5), 1)[0], 0);
  // White against black is 100 Lab units, and above white the Lab distance is clipped.
  assert.ok(Math.abs(errorMap("lab", flat(1), flat(0), 1)[0]! - 100) < 0.01);
  assert.equal(errorMap("lab", flat(8), flat(1), 1)[0], 0);
  assert.ok(Math.abs(errorMap("luminance", flat(0.5), flat(0.25), 2)[0]! - 0.5) < 1e-4);
  assert.ok(Math.abs(errorMap("relative", flat(1), flat(0.5), 1)[0]! - 0.25 / 0.26) < 1e-6);
});

test("pixels take the display's values and the legend's colours", () => {
  const out = new Uint8ClampedArray(4);
  colourPicture(new Picture(1, 1, Uint16Array.from([1, 0.25, 0].map(toHalf))), "srgb", 2, out);
  assert.deepEqual([...out], [255, Math.round(255 * srgbEncode(0.5)), 0, 255]);
  colourErrors(Float32Array.from([5]), "lab", 10, out);
  assert.deepEqual([...out.slice(0, 3)], [...EMBER.slice(3 * 128, 3 * 129)]);
  colourErrors(Float32Array.from([NaN]), "lab", 10, out);
  assert.deepEqual([...out.slice(0, 3)], [...EMBER.slice(0, 3)]);
});

test("zooming leaves the point under the pointer where it is", () => {
  const picture = { width: 200, height: 100 };
  const pane = { width: 600, height: 600 };
  const once = zoomedAt(WHOLE, 8, 300, 300, picture, pane);
  const twice = zoomedAt(once, 1.7, 250, 330, picture, pane);
  assert.deepEqual(pixelAt(twice, 250, 330, picture, pane), pixelAt(once, 250, 330, picture, pane));
  assert.equal(transform(WHOLE, picture, pane).scale, 3);
  assert.equal(fitScale(picture, pane), 3);
});

test("the picture cannot be dragged out of its pane", () => {
  const picture = { width: 100, height: 100 };
  const pane = { width: 100, height: 100 };
  assert.deepEqual(movedBy(WHOLE, 40, -70, picture, pane), WHOLE);
  assert.equal(movedBy({ x: 0.5, y: 0.5, zoom: 4 }, 1e6, 0, picture, pane).x, 1 / 8);
  assert.equal(contained({ x: 0.5, y: 0.5, zoom: 1e9 }, picture, pane).zoom, 64);
  assert.equal(pixelAt(WHOLE, -1, 5, picture, pane), undefined);
});

test("a link's hash gives back the view that it was made from", () => {
  const normal = defaultView(index, library);
  assert.equal(toHash(normal, normal), "");
  const view: View = {
    ...normal,
    tab: "numbers",
    scene: "smoke",
    spp: 16,
    a: "reference",
    b: "nl_means_default",
    mode: "grid",
    stops: -1.5,
    x: 0.25,
    zoom: 3.5,
    hidden: ["noisy", "bilateral_default"],
    setting: "",
    sort: "psnr",
    descending: true,
  };
  assert.deepEqual(fromHash(`#${toHash(view, normal)}`, normal, index), view);
});

test("a hash of another evaluation is passed over", () => {
  const normal = defaultView(index, library);
  assert.deepEqual(
    fromHash("#scene=moon&spp=5&a=none&tab=x&zoom=-3&gain=1e9&stops=a&hidden=nobody", normal, index),
    normal,
  );
});

test("at first the best method of the best setting stands beside path tracing", () => {
  const view = defaultView(index, library);
  assert.equal(view.setting, "searched");
  assert.equal(view.a, "noisy");
  assert.equal(view.b, "transport_regression_searched");
  assert.deepEqual(listedMethods(index, { ...view, metric: "psnr" })[0], "transport_regression_searched");
  assert.equal(listedMethods(index, { ...view, scene: "smoke" }).at(-1), "nl_means_searched");
});

test("an evaluation with nothing but scenes is no error", () => {
  const bare = new Index(complete({ scenes: [{ name: "only" }] }));
  const view = defaultView(
    bare,
    new Library(
      [],
      () => {},
      () => {},
    ),
  );
  assert.equal(view.scene, "only");
  assert.deepEqual(listedMethods(bare, view), []);
  assert.deepEqual(fromHash("", view, bare), view);
});

test("numbers that could not be measured are left out", () => {
  const raw = JSON.parse(
    '{"rows":[{"scene":"s","spp":1,"method":"m","region":"frame","metrics":{"a":{"mean":null},"b":{"mean":2},"c":null}}]}',
  );
  assert.deepEqual(complete(raw).rows[0]!.metrics, { b: { mean: 2 } });
});

test("ablations of other parameters or sample counts are shown where there are no others", () => {
  const view = defaultView(index, library);
  const other = [{ method: "bilateral_default" }];
  assert.deepEqual(measuredMethods(index, view, other), ["bilateral_default"]);
  assert.deepEqual(measuredMethods(index, view, [...other, { method: "nl_means_searched" }]), ["nl_means_searched"]);
  assert.equal(nearest([4, 64, 16], 20), 16);
  assert.equal(nearest([], 20), 20);
});

test("verdicts read the same from both sides", () => {
  const forth = index.verdict("cloud", 4, "frame", "lab_rms", "noisy", "bilateral_default")!;
  const back = index.verdict("cloud", 4, "frame", "lab_rms", "bilateral_default", "noisy")!;
  assert.equal(forth.better, "column");
  assert.equal(back.better, "row");
  assert.equal(forth.difference, -back.difference);
});

test("parameters are read as text, list or object", () => {
  assert.deepEqual(listed("a=1 b=2,c"), [
    ["a", "1"],
    ["b", "2"],
    ["c", ""],
  ]);
  assert.deepEqual(listed({ a: 1, b: "x" }), [
    ["a", "1"],
    ["b", "x"],
  ]);
  assert.deepEqual(listed(["albedo"]), [["albedo", ""]]);
  assert.deepEqual(listed(undefined), []);
  assert.deepEqual(index.parameters("smoke", 4, "bilateral_searched")[0], ["strength", "0.4"]);
});

test("numbers are printed with as many digits as they bear", () => {
  assert.deepEqual([0, 12.345, 0.98765, 0.00012345, 1e-7, 123456, undefined].map(number), [
    "0",
    "12.35",
    "0.988",
    "0.000123",
    "1.00e−7",
    "1.23e5",
    "–",
  ]);
  assert.equal(percent(-0.123), "−12 %");
  assert.equal(stops(-0.5), "−0.5 EV");
});

test("logarithmic axes have round ticks, as many as there is room for", () => {
  assert.deepEqual(logTicks(0.9, 60), [1, 2, 5, 10, 20, 50]);
  assert.deepEqual(logTicks(0.9, 3.5), [1, 1.5, 2, 3]);
  assert.deepEqual(logTicks(0.001, 100), [0.001, 0.01, 0.1, 1, 10, 100]);
});

test("pairs are found by both of their methods, in the setting that has both", () => {
  const metrics = (mean: number) => ({ psnr: { mean } });
  const means = { noisy: 20, a_default: 30, b_default: 31, b_searched: 36 };
  const at = { scene: "cloud", spp: 4, region: "frame" as const };
  const bare = new Index(
    complete({
      ...results,
      rows: Object.entries(means).map(([method, mean]) => ({ ...at, method, metrics: metrics(mean) })),
      pairs: [
        { ...at, metric: "psnr", methods: ["noisy", "a_default", "b_default"], half_width: [1, 2, 3], better: "bb-" },
        { ...at, metric: "psnr", methods: ["noisy", "b_searched"], half_width: [4], better: "b" },
      ],
    }),
  );
  const verdict = (a: string, b: string) => bare.verdict("cloud", 4, "frame", "psnr", a, b);
  assert.deepEqual(verdict("a_default", "b_default"), { difference: -1, half_width: 3, better: null });
  assert.deepEqual(verdict("b_default", "noisy"), { difference: 11, half_width: 2, better: "row" });
  assert.deepEqual(verdict("noisy", "b_searched"), { difference: -16, half_width: 4, better: "column" });
  assert.equal(verdict("a_default", "b_searched"), undefined, "of another setting");
});

test("the overall answer is among the methods that are shown, with what is level with it", () => {
  const overall = index.overall("medium", "lab_rms", "searched")!;
  const all = overall.methods.map((m) => m.method);
  const told = (shown: string[]) => answers(overall, shown).map(({ best, level }) => [best?.method, ...level]);
  assert.deepEqual(told(all), [
    ["transport_regression_searched"],
    ["nl_means_searched", "gradient_kernel_searched"],
    ["nl_means_searched", "gradient_kernel_searched"],
  ]);
  const cards = (shown: string[]) =>
    together(answers(overall, shown)).map((g) => g.questions.map((q) => q.id).join(" "));
  assert.deepEqual(cards(all), ["best", "quick plain"]);
  assert.deepEqual(cards(["nl_means_searched"]), ["best quick plain"]);
  assert.deepEqual(told(["bilateral_searched", "gradient_kernel_searched", "transport_regression_searched"])[1], [
    "gradient_kernel_searched",
  ]);
  assert.deepEqual(told(["nl_means_searched"])[2], ["nl_means_searched"], "what is hidden is not level with anything");
  assert.deepEqual(told(["transport_regression_searched"])[2], [undefined], "no other one does without guides");
});

test("references are noisy where their own error is beyond that of the best shown method", () => {
  const view = { ...defaultView(index, library), region: "medium" as const };
  const at = (change: Partial<View>) =>
    noisyReferences(index, { ...view, ...change }).map((n) => `${n.scene} ${n.spp} ${n.metric}`);
  // The best of the cloud has 2.04 at 4 samples and 1.02 at 16; its references 1.25.
  assert.deepEqual(at({}), ["cloud 16 lab_rms"]);
  assert.deepEqual(at({ region: "frame" }), []);
  assert.deepEqual(at({ metric: "psnr" }), [], "60 dB are less noise than the best method's 39");
  assert.deepEqual(at({ metric: "relative_bias" }), ["cloud 16 lab_rms"], "which says nothing of noise by itself");
  const hidden = listedMethods(index, view).filter((id) => id !== "noisy");
  assert.deepEqual(at({ hidden }), [], "of path tracing alone");
});

test("rings follow region, metric and setting, and stand at shown methods only", () => {
  const rings = (ids: string[], region: "frame" | "medium", setting: string, metric = "lab_rms") =>
    lines(index, String, ids, "cloud", region, metric, "seconds", setting).flatMap((l) =>
      l.points.filter((p) => p.front).map((p) => `${l.id} ${p.spp}`),
    );
  const ids = index.results.methods.map((m) => m.id);
  assert.deepEqual(rings(ids, "frame", "searched"), ["noisy 4", "bilateral_searched 16"]);
  assert.deepEqual(rings(ids, "medium", "searched"), ["noisy 4", "nl_means_searched 16"]);
  assert.deepEqual(rings(ids, "medium", ""), ["transport_regression_default 4"]);
  assert.deepEqual(rings(["noisy"], "medium", "searched"), ["noisy 4"]);
  assert.deepEqual(rings(ids, "medium", "searched", "relative_bias"), [], "of which there is no front");
});

test("CSV quotes what its format means otherwise, and keeps every digit", () => {
  assert.equal(
    csv([
      ["a,b", 'say "so"', "two\nlines"],
      [0.1 + 0.2, undefined, null],
      [NaN, "", 3],
    ]),
    '"a,b","say ""so""","two\nlines"\r\n0.30000000000000004,,\r\n,,3\r\n',
  );
});

test("a plot's figure has every point, interval and ring, and names that are no markup", () => {
  const line = {
    id: "m",
    name: "a<b",
    points: [1, 10].map((x) => ({ x, y: 3 / x, low: 2 / x, high: 4 / x, spp: x, front: x === 1 })),
  };
  const svg = plotSvg({
    title: "T & U",
    origin: "o",
    x: "s",
    y: "e",
    lines: [line],
    styles: new Map([["m", { colour: "rgb(1, 2, 3)", dash: [] }]]),
  });
  const count = (what: RegExp) => [...svg.matchAll(what)].length;
  assert.equal(count(/<circle cx="[0-9.]+" cy="[0-9.]+" r="3.5"/g), 3, "two points, and the key's");
  assert.equal(count(/class="front"/g), 1);
  assert.ok(svg.includes("a&lt;b") && svg.includes("T &amp; U") && !svg.includes("NaN"));
});

test("small memory has digits, too", () => {
  assert.deepEqual([3 * 2 ** 18, 2.5 * 2 ** 20, 40 * 2 ** 20, 3 * 2 ** 30].map(bytes), [
    "768 KiB",
    "2.5 MiB",
    "40 MiB",
    "3.00 GiB",
  ]);
});
