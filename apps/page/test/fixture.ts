// A small evaluation made up for the tests, with every part that a real one may have.
import { deflateSync } from "node:zlib";
import type { PictureEntry, Results } from "../src/results";

/** Packs as image/packed_half.cpp does, written apart from the page's unpacking. */
export function pack(half: Uint16Array, width: number, height: number): Buffer {
  const size = width * height;
  const ordered = (bits: number) => (bits & 0x8000 ? ~bits & 0xffff : bits | 0x8000);
  const planes = [new Int32Array(size), new Int32Array(size), new Int32Array(size)] as const;
  for (let i = 0; i < size; ++i) {
    const green = ordered(half[size + i]!);
    planes[0][i] = green;
    planes[1][i] = (ordered(half[i]!) - green + 32768) & 0xffff;
    planes[2][i] = (ordered(half[2 * size + i]!) - green + 32768) & 0xffff;
  }
  const bytes = Buffer.alloc(6 * size);
  planes.forEach((plane, c) => {
    for (let i = 0; i < size; ++i) {
      const [x, y] = [i % width, Math.floor(i / width)];
      const above = y > 0 ? plane[i - width]! : undefined;
      const left = x > 0 ? plane[i - 1]! : (above ?? 32768);
      const up = above ?? left;
      const corner = x > 0 && y > 0 ? plane[i - width - 1]! : up;
      const smooth = left + up - corner;
      const predicted = [left, up, smooth].sort((p, q) => p - q)[1]!;
      const residual = ((plane[i]! - predicted + 32768) & 0xffff) - 32768;
      const folded = residual < 0 ? -2 * residual - 1 : 2 * residual;
      bytes[c * size + i] = folded >> 8;
      bytes[3 * size + c * size + i] = folded & 255;
    }
  });
  return deflateSync(bytes);
}

/** The nearest half of a number, for what the tests need: zero and normal numbers. */
export function toHalf(value: number): number {
  if (value === 0) return 0;
  const sign = value < 0 ? 0x8000 : 0;
  const exponent = Math.floor(Math.log2(Math.abs(value)));
  return sign | (((exponent + 15) << 10) + Math.round((Math.abs(value) / 2 ** exponent - 1) * 1024));
}

const WIDTH = 40;
const HEIGHT = 30;

/** A soft ball with some noise; the same for the same arguments. */
function ball(brightness: number, noise: number, seed: number): Uint16Array {
  let state = seed * 7919 + 12345;
  const random = () => (state = (Math.imul(state, 1103515245) + 12345) >>> 0) / 2 ** 32 - 0.5;
  const half = new Uint16Array(3 * WIDTH * HEIGHT);
  for (let i = 0; i < WIDTH * HEIGHT; ++i) {
    const [x, y] = [(i % WIDTH) / WIDTH - 0.5, (Math.floor(i / WIDTH) - HEIGHT / 2) / WIDTH];
    const light = brightness * Math.max(0, 1 - 9 * (x * x + y * y));
    for (let c = 0; c < 3; ++c) half[c * WIDTH * HEIGHT + i] = toHalf(0.2 + 0.05 * c + light * (1 + noise * random()));
  }
  return half;
}

const FILTERS = ["bilateral", "gradient_kernel", "nl_means", "transport_regression"];

export function fixture(): {
  results: Results;
  html: (script: string, style: string) => string;
  pictures: PictureEntry[];
} {
  const spp = [4, 16];
  const scenes = ["cloud", "smoke"];
  const metrics = [
    {
      id: "lab_rms",
      name: "Lab RMS",
      unit: "Lab",
      better: "lower" as const,
      definition: "root mean square distance in CIE-Lab",
    },
    { id: "psnr", name: "PSNR", unit: "dB", better: "higher" as const, definition: "of the peak 1" },
    {
      id: "relative_bias",
      name: "relative bias",
      unit: "1",
      better: "zero" as const,
      definition: "mean of x over mean of r, less 1",
    },
  ];
  const methods: Results["methods"] = [
    { id: "noisy", label: "path tracing", filter: "", parameters: "", features: [], setting: "none" },
  ];
  for (const filter of FILTERS)
    for (const setting of ["default", "searched"])
      methods.push({
        id: `${filter}_${setting}`,
        label: filter,
        filter,
        parameters: setting === "default" ? "strength=0.45 radius=6" : "",
        features: ["albedo"],
        setting,
      });
  const results: Results = {
    brume: "0.1.0",
    commit: "0123456789ab",
    command: "brume evaluate </script> cloud.toml",
    machine: { cpu: "made up", threads: 2 },
    experiment: { reference_spp: 256 },
    // The references of the cloud are noisier than the best method over the medium, and nowhere else.
    scenes: scenes.map((name) => ({
      name,
      hash: "00ff",
      exposure: 1,
      width: WIDTH,
      height: HEIGHT,
      references: 2,
      reference_errors: {
        frame: { lab_rms: 0.01, psnr: 60 },
        medium: { lab_rms: name === "cloud" ? 1.25 : 0.01, psnr: 60 },
      },
    })),
    spp,
    seeds: [1, 2, 3],
    metrics,
    methods,
    rows: [],
    pairs: [],
    overall: [],
    pareto: [],
    time_to_error: [],
    ablation: [],
    sensitivity: [],
    sequences: [
      {
        name: "shot",
        frames: [1, 2, 3],
        reference_change: { frame: 0.5, medium: 1.25 },
        rows: [
          { reach: 0, temporal_error: 0.75 },
          { reach: 3, temporal_error: 0.5 },
        ].map(({ reach, temporal_error }) => ({
          spp: 4,
          label: "transport_regression",
          reach,
          region: "frame" as const,
          lab_rms: { mean: 0.25, half_width: 0.01 },
          temporal_error: { mean: temporal_error, half_width: 0.01 },
          flicker: { mean: -0.01, half_width: 0.001 },
          filter_seconds: 0.25,
        })),
      },
    ],
  };
  const pictures: PictureEntry[] = [];
  const packed: string[] = [];
  const add = (scene: string, count: number, method: string, half: Uint16Array) => {
    pictures.push({ scene, spp: count, method, width: WIDTH, height: HEIGHT, data: packed.length });
    packed.push(pack(half, WIDTH, HEIGHT).toString("base64"));
  };
  for (const [s, scene] of scenes.entries()) {
    add(scene, 0, "reference", ball(0.6 - 0.2 * s, 0, 1));
    for (const n of spp) {
      const errors = methods.map((_, k) => ((k === 0 ? 12 : 5 - 0.37 * k) * 2) / Math.sqrt(n));
      for (const region of ["frame", "medium"] as const)
        for (const metric of ["lab_rms", "psnr"]) {
          const differences = errors.flatMap((a, k) =>
            errors.slice(k + 1).map((b) => (metric === "psnr" ? b - a : a - b)),
          );
          results.pairs.push({
            scene,
            spp: n,
            region,
            metric,
            methods: methods.map((m) => m.id),
            half_width: differences.map(() => 0.3),
            better: differences
              .map((d) => (Math.abs(d) < 0.3 ? "-" : (metric === "psnr") === d > 0 ? "a" : "b"))
              .join(""),
          });
        }
      for (const [k, m] of methods.entries()) {
        const failed = scene === "smoke" && m.id === "nl_means_searched" && n === 4;
        const error = errors[k]!;
        for (const region of ["frame", "medium"] as const) {
          const values = [error * 0.99, error, error * 1.01];
          const row = {
            scene,
            spp: n,
            method: m.id,
            region,
            ...(k && { peak_memory_bytes: 3 * k * 2 ** 20 }),
            seconds: { render: 0.1 * n, guides: k > 4 ? 0.03 : 0, filter: k ? 0.01 * k : 0 },
          };
          if (failed) results.rows.push({ ...row, metrics: {}, failed: "a layer that it needs is missing" });
          else
            results.rows.push({
              ...row,
              metrics: {
                lab_rms: { mean: error, half_width: 0.025 * error, values },
                psnr: { mean: 40 - error, half_width: 0.1, values },
                relative_bias: { mean: k % 2 ? -0.01 * k : 0.012 * k + 0.001, half_width: 0.001 },
              },
              ...(["noisy", "bilateral_searched"].includes(m.id) && {
                lights: {
                  direct: { lab_rms: { mean: 0.5 * error, half_width: 0.01 } },
                  indirect: { lab_rms: { mean: 0.25 * error, half_width: 0.01 } },
                },
              }),
              parameters: m.setting === "searched" ? `strength=${0.3 + 0.1 * s} radius=6` : m.parameters,
              at_the_edge: m.id === "bilateral_searched" ? ["radius"] : [],
            });
          if (m.setting === "searched" && !failed) {
            for (const layer of ["albedo", "gradient"])
              for (const how of ["without", "alone"] as const)
                results.ablation.push({
                  scene,
                  spp: n,
                  method: m.id,
                  layer,
                  how,
                  region,
                  metrics: { lab_rms: { mean: error * (how === "alone" ? 1.3 : layer === "albedo" ? 1.1 : 0.95) } },
                });
            for (const value of [0.1, 0.2, 0.3, 0.6, 1.2])
              results.sensitivity.push({
                scene,
                spp: n,
                method: m.id,
                parameter: "strength",
                value,
                region,
                metrics: { lab_rms: { mean: error * (1 + 0.3 * Math.log(value / 0.3) ** 2) } },
              });
            for (const value of ["linear", "domain"])
              results.sensitivity.push({
                scene,
                spp: n,
                method: m.id,
                parameter: "average",
                value,
                region,
                metrics: { lab_rms: { mean: error * (value === "linear" ? 1 : 1.2) } },
              });
          }
        }
        if (!failed) add(scene, n, m.id, ball(0.6 - 0.2 * s, error / 4, 2 + k + n));
      }
    }
  }
  // What C++ would have found: other numbers for each region and metric, so that a mixed-up one is seen.
  for (const region of ["frame", "medium"] as const)
    for (const metric of ["lab_rms", "psnr"]) {
      const [r, m] = [region === "frame" ? 1 : 2, metric === "psnr" ? 10 : 0];
      for (const scene of scenes) {
        for (const setting of ["", "default", "searched"])
          results.pareto.push({
            scene,
            region,
            metric,
            setting,
            front:
              setting === "searched"
                ? [
                    { method: "noisy", spp: 4 },
                    { method: region === "frame" ? "bilateral_searched" : "nl_means_searched", spp: 16 },
                  ]
                : [{ method: "transport_regression_default", spp: 4 }],
          });
        results.time_to_error.push({
          scene,
          region,
          metric,
          times: ["noisy", "nl_means_default", "nl_means_searched", "bilateral_searched"].map((method, k) => ({
            method,
            error: r + m,
            seconds: 0.25 * (k + 1) * r,
            factor_over_path_tracing: 12,
            factor_over_gradient_kernel: null,
          })),
        });
      }
      for (const setting of ["", "default", "searched"]) {
        const ids = methods.filter((x) => x.setting === "none" || !setting || x.setting === setting).map((x) => x.id);
        const ordered = [...ids].sort(
          (x, y) => methods.findIndex((v) => v.id === y) - methods.findIndex((v) => v.id === x),
        );
        results.overall.push({
          region,
          metric,
          setting,
          scenes,
          spp,
          seeds: 3,
          mean: metric === "psnr" ? "arithmetic" : "geometric",
          // transport_regression reads guides and is slow; gradient_kernel cannot be told from nl_means.
          methods: ordered.map((id, k) => ({
            method: id,
            value: r + m + 0.125 * k,
            times_less_than_noisy: metric === "psnr" ? null : 8 / (k + 1),
            seconds: id === "noisy" ? 0 : id.startsWith("transport") ? 0.75 : 0.0625 * (k + 1),
            most_seconds: id === "noisy" ? 0 : id.startsWith("transport") ? 0.875 : 0.125 * (k + 1),
            most_memory_bytes: id === "noisy" ? null : (k + 1) * 2 ** 20,
            guides: id.startsWith("transport"),
            level_with: id.startsWith("nl_means") ? ordered.filter((x) => x.startsWith("gradient_kernel")) : [],
          })),
          left_out: [],
        });
      }
    }
  const inside = (value: unknown) => JSON.stringify(value).replace(/</g, "\\u003c");
  const html = (script: string, style: string) =>
    `<!doctype html><html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1"><title>brume: fixture</title>` +
    `<meta http-equiv="Content-Security-Policy" content="default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:"><link rel="icon" href="data:,"><style>${style}</style></head><body><div id="app"></div>` +
    `<script type="application/json" id="results">${inside(results)}</script><script type="application/json" id="pictures">${inside(pictures)}</script>` +
    `<script>${script}</script>${packed.map((text, i) => `<script type="text/plain" id="picture-${i}">${text}</script>`).join("\n")}</body></html>`;
  return { results, html, pictures };
}
