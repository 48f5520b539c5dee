// A program for the page to talk to, inside of the browser: a shaded ball that follows camera, light and layers.
import type { Page } from "playwright-core";

export interface FakeOptions {
  frames?: number[];
  /** The sun's light is the group "key", the sky's is "sky"; what is noisy is not known by group. */
  mixes?: boolean;
}

/** What tests reach through `window.fake`. */
export interface Fake {
  /** Messages of the page, oldest first. */
  sent: {
    type: string;
    set: string[];
    moving: boolean;
    layers: string[];
    size: [number, number];
    frame: number | null;
    mix?: Record<string, number[]>;
  }[];
  /** Pretends that the program ended, or that it is there again. */
  lose: () => void;
  comeBack: () => void;
  problem: (text: string) => void;
  /** Any message of the program. */
  tell: (message: object) => void;
  /** Looks at rest are answered with a coarse picture, without samples or progress. */
  coarse: boolean;
  /** Layers that are not answered. */
  without: string[];
  /** The scene no longer has light groups. */
  ungrouped: boolean;
  /** How often the page has tried to connect. */
  tries: number;
}

/** Replaces the WebSocket of all documents that the page will load. */
export async function withFake(page: Page, options: FakeOptions = {}): Promise<void> {
  await page.addInitScript(fakeProgram, options);
}

function fakeProgram({ frames, mixes }: FakeOptions): void {
  type Value = number | boolean | string | number[];
  type Fields = Record<string, [type: string, value: Value, more?: object]>;
  const tables: Record<string, { title: string; fields: Fields; more?: object }> = {
    camera: {
      title: "camera",
      fields: {
        type: ["choice", "perspective", { choices: ["perspective", "orthographic"], help: "how rays spread" }],
        position: ["vector", [0, -6, 1], { unit: "scene units", help: "the eye" }],
        look_at: ["vector", [0, 0, 0], { unit: "scene units" }],
        up: ["vector", [0, 0, 1]],
        fov: [
          "number",
          33,
          { unit: "degrees", lowest: 0.001, highest: 179, help: "full angle of view along fov_axis" },
        ],
        lens_radius: ["number", 0, { unit: "scene units", lowest: 0 }],
        focus_distance: ["number", 0, { unit: "scene units", lowest: 0 }],
      },
    },
    film: {
      title: "film",
      fields: {
        width: ["integer", 400, { unit: "px", lowest: 1, highest: 65536 }],
        height: ["integer", 300, { unit: "px", lowest: 1, highest: 65536 }],
        exposure: ["number", 1, { unit: "1", lowest: 1e-12 }],
      },
    },
    environment: {
      title: "environment",
      fields: {
        radiance: ["color", [0.16, 0.21, 0.31], { unit: "W/(m^2 sr)", lowest: 0 }],
        sky: ["choice", "none", { choices: ["none", "preetham"] }],
        turbidity: ["number", 3, { lowest: 1.9, highest: 10 }],
        sun_direction: ["vector", [0.5, 0.3, 0.6]],
        file: ["text", "", { fixed: true }],
      },
    },
    "volumes.0": {
      title: "ball.vdb",
      more: { optical_depth: [57.7, 30.7, 52.6], grids: ["density"] },
      fields: {
        enabled: ["switch", true],
        file: ["text", "ball.vdb", { fixed: true, help: "OpenVDB file" }],
        grid: ["choice", "density", { choices: ["density"] }],
        sigma_t: ["color", [40, 40, 40], { unit: "1 / scene unit", lowest: 0, help: "extinction per density" }],
        density: ["number", 1, { unit: "1", lowest: 0, help: "factor on the density grid" }],
        albedo: ["color", [0.9, 0.6, 0.3], { unit: "1", lowest: 0, highest: 1 }],
        phase: ["choice", "henyey_greenstein", { choices: ["henyey_greenstein", "two_lobes", "mie"] }],
        g: ["number", 0.6, { unit: "1", lowest: -0.999, highest: 0.999, help: "mean cosine, positive forward" }],
        emission: ["color", [0, 0, 0], { lowest: 0 }],
        index_offset: ["vector", [0, 0, 0], { unit: "voxels" }],
        flame_ramp: ["numbers", [0, 1, 0, 0]],
      },
    },
    "lights.0": {
      title: "sun",
      fields: {
        enabled: ["switch", true],
        type: ["choice", "sun", { fixed: true, choices: ["sun", "sphere"] }],
        direction: ["vector", [-0.8, -0.25, 0.55]],
        irradiance: ["color", [3.4, 3, 2.4], { unit: "W/m^2", lowest: 0 }],
        angular_diameter: ["number", 0.53, { unit: "degrees", lowest: 0, highest: 180 }],
      },
    },
  };
  const LAYERS = [
    { name: "picture", title: "picture", channels: 3, group: "", unit: "W/(m^2 sr)" },
    { name: "noisy", title: "noisy", channels: 3, group: "path traced", unit: "W/(m^2 sr)" },
    { name: "depth", title: "depth", channels: 1, group: "shape of the media", unit: "scene units" },
  ];

  const halfOf = (value: number): number => {
    if (!(value > 0)) return 0;
    const exponent = Math.min(15, Math.max(-14, Math.floor(Math.log2(value))));
    const fraction = Math.round((value / 2 ** exponent - 1) * 1024);
    return value < 2 ** -14 ? Math.round(value * 2 ** 24) : ((exponent + 15) << 10) + fraction;
  };
  const unit = (v: number[]) => v.map((x) => x / Math.hypot(...v));
  const dot = (a: number[], b: number[]) => a[0]! * b[0]! + a[1]! * b[1]! + a[2]! * b[2]!;
  const cross = (a: number[], b: number[]) => [
    a[1]! * b[2]! - a[2]! * b[1]!,
    a[2]! * b[0]! - a[0]! * b[2]!,
    a[0]! * b[1]! - a[1]! * b[0]!,
  ];
  const read = (text: string): Value | Record<string, Value> =>
    JSON.parse(text.replace(/([{,])([a-z_]+)=/g, '$1"$2":')) as Value;

  let known: object | undefined;
  const groups = (set: string[]) => {
    const all = JSON.parse(JSON.stringify(tables)) as typeof tables;
    for (const assignment of set) {
      const at = assignment.indexOf("=");
      const path = assignment.slice(0, at);
      const value = read(assignment.slice(at + 1));
      const table = path.slice(0, path.lastIndexOf("."));
      const key = path.slice(path.lastIndexOf(".") + 1);
      if (/^lights\.\d+$/.test(path)) {
        const fields: Fields = { enabled: ["switch", true] };
        const types: Record<string, string> = {
          type: "text",
          position: "vector",
          direction: "vector",
          radius: "number",
        };
        for (const [k, v] of Object.entries(value)) fields[k] = [types[k] ?? "color", v as Value];
        all[path] = { title: String((value as Record<string, Value>)["type"]), fields };
      } else if (all[table]) {
        const [type, , rest] = all[table]!.fields[key] ?? ["text", ""];
        all[table]!.fields[key] = [type, value as Value, ...(rest ? [rest] : [])] as Fields[string];
      }
    }
    return all;
  };

  let there = true;
  class FakeSocket extends EventTarget {
    static readonly OPEN = 1;
    binaryType = "";
    bufferedAmount = 0;
    readyState = 0;
    onopen?: () => void;
    onclose?: () => void;
    onmessage?: (event: { data: unknown }) => void;

    constructor(readonly url: string) {
      super();
      ++fake.tries;
      setTimeout(() => {
        if (!there) return this.close();
        current = this;
        this.readyState = 1;
        known = undefined;
        this.onopen?.();
      }, 10);
    }
    close(): void {
      this.readyState = 3;
      this.onclose?.();
    }
    tell(message: object | ArrayBuffer): void {
      setTimeout(() => {
        if (this.readyState !== 1) return;
        this.onmessage?.({ data: message instanceof ArrayBuffer ? message : JSON.stringify(message) });
      }, 5);
    }
    send(text: string): void {
      const message = JSON.parse(text) as Fake["sent"][0] & { id: number; x: number; y: number };
      fake.sent.push(message);
      if (message.type === "probe") {
        const hit = Math.hypot(message.x - 0.5, message.y - 0.5) < 0.3;
        this.tell({ type: "point", id: message.id, position: hit ? [0.1, -0.9, 0.2] : null });
        return;
      }
      const all = groups(message.set);
      if (!message.moving && JSON.stringify(all) !== JSON.stringify(known)) {
        known = all;
        this.tell({
          type: "scene",
          id: message.id,
          name: "ball",
          frames: frames ?? null,
          command: ["brume render ball.toml", ...message.set.map((s) => `-D '${s}'`), "--clean -o ball.exr"].join(" "),
          bounds: [
            [-1, -1, -1],
            [1, 1, 1],
          ],
          layers: LAYERS,
          ...(mixes && !fake.ungrouped ? { light_groups: ["key", "sky"] } : {}),
          notes: ["The ball is made up."],
          left_out: message.set.some((s) => s.includes('"sphere"')) ? ["light of lights.1"] : [],
          groups: Object.entries(all).map(([path, { title, fields, more }]) => ({
            path,
            title,
            ...more,
            fields: Object.entries(fields).map(([key, [type, value, rest]]) => ({ key, type, value, ...rest })),
          })),
        });
      }
      this.tell({ type: "progress", id: message.id, stage: "marching", samples: 0, error: null, seconds: 0.02 });
      const share = message.moving ? 0.5 : fake.coarse ? 0.125 : 1;
      for (const layer of message.layers)
        if (!fake.without.includes(layer)) this.tell(this.picture(message, layer, all, share));
      if (!message.moving && !fake.coarse)
        this.tell({ type: "progress", id: message.id, stage: "done", samples: 16, error: 0.012, seconds: 1.25 });
    }
    picture(message: Fake["sent"][0] & { id: number }, layer: string, all: typeof tables, share: number): ArrayBuffer {
      const [width, height] = message.size.map((n) => Math.max(1, Math.round(n * share))) as [number, number];
      const value = (table: string, key: string) => all[table]!.fields[key]![1] as number[];
      const position = value("camera", "position");
      const at = value("camera", "look_at");
      const forward = unit(at.map((v, i) => v - position[i]!));
      const right = unit(cross(forward, value("camera", "up")));
      const up = cross(right, forward);
      const sun = unit(value("lights.0", "direction"));
      const gain = (group: string) => (layer === "noisy" ? undefined : message.mix?.[group]) ?? [1, 1, 1];
      const bright = all["lights.0"]!.fields["enabled"]![1] ? value("lights.0", "irradiance") : [0, 0, 0];
      const sky = value("environment", "radiance");
      const albedo = value("volumes.0", "albedo");
      const extent = Math.tan((Number(value("camera", "fov")) * Math.PI) / 360);
      const radius = 1 + 0.1 * ((message.frame ?? 0) % 5);
      const channels = layer === "depth" ? 1 : 3;
      const header = JSON.stringify({
        id: message.id,
        layer,
        width,
        height,
        channels,
        stage: share < 1 ? "predicted" : "clean",
        full: share === 1,
        samples: share < 1 ? 0 : 16,
        error: share < 1 ? null : 0.012,
        seconds: 0.02,
        exposure: 1,
        frame: message.frame ?? frames?.[0] ?? null,
        ...(layer === "noisy" && message.mix ? { mixed: false } : {}),
      });
      const padded = header.padEnd(Math.ceil(header.length / 4) * 4);
      const buffer = new ArrayBuffer(4 + padded.length + 2 * width * height * channels);
      new DataView(buffer).setUint32(0, padded.length, true);
      new Uint8Array(buffer, 4, padded.length).set(new TextEncoder().encode(padded));
      const out = new Uint16Array(buffer, 4 + padded.length);
      const size = width * height;
      for (let y = 0; y < height; ++y)
        for (let x = 0; x < width; ++x) {
          const [u, v] = [((2 * x + 1) / width - 1) * extent, ((1 - (2 * y + 1) / height) * extent * height) / width];
          const ray = unit(forward.map((f, i) => f + u * right[i]! + v * up[i]!));
          const b = dot(position, ray);
          const inside = b * b - dot(position, position) + radius * radius;
          const t = -b - Math.sqrt(Math.max(0, inside));
          const hit = inside > 0 && t > 0;
          const normal = position.map((p, i) => (p + t * ray[i]!) / radius);
          const stripes = 0.8 + 0.2 * Math.sin(12 * Math.atan2(normal[1]!, normal[0]!));
          for (let c = 0; c < channels; ++c) {
            const lit = hit
              ? albedo[c]! *
                stripes *
                (gain("sky")[c]! * sky[c]! + ((gain("key")[c]! * bright[c]!) / Math.PI) * Math.max(0, dot(normal, sun)))
              : gain("sky")[c]! * sky[c]!;
            const noise = layer === "noisy" ? 0.6 + 0.8 * ((Math.sin(12.9898 * x + 78.233 * y) * 43758.5453) % 1) : 1;
            out[c * size + y * width + x] = halfOf(channels === 1 ? (hit ? t : 0) : lit * noise);
          }
        }
      return buffer;
    }
  }

  let current: FakeSocket | undefined;
  const fake: Fake = {
    sent: [],
    lose: () => {
      there = false;
      current?.close();
    },
    comeBack: () => (there = true),
    problem: (text) => current?.tell({ type: "problem", id: 1e9, text }),
    tell: (message) => current?.tell(message),
    coarse: false,
    without: [],
    ungrouped: false,
    tries: 0,
  };
  Object.assign(window, { fake, WebSocket: FakeSocket });
}
