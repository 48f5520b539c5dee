// What brume evaluate hands over: the JSON of one evaluation (docs/experiment.md). Everything but scenes, methods and rows
// may be missing, and the page leaves out what is not there.

export type Region = "medium" | "frame";

export interface Scene {
  name: string;
  hash?: string;
  exposure?: number;
  width?: number;
  height?: number;
  /** Of the frame's pixels. */
  medium_share?: number;
  references?: number;
  reference_spp?: number;
  /** Lab RMS noise of one reference. */
  reference_noise?: number;
  /** What noise makes the mean of the references differ from the true picture by, by metric, where that is known. */
  reference_errors?: Partial<Record<Region, Record<string, number>>>;
}

export interface Metric {
  id: string;
  name: string;
  unit?: string;
  better: "lower" | "higher" | "zero";
  definition?: string;
}

export interface Method {
  id: string;
  label: string;
  filter?: string | null;
  parameters?: unknown;
  features?: unknown;
  setting?: string | null;
  /** The words of a filter that is not brume's: a command, or a function. */
  command?: string;
}

export interface Estimate {
  mean: number;
  half_width?: number | null;
  values?: number[];
}

export interface Seconds {
  render?: number;
  guides?: number;
  filter?: number;
  /** Of handing files to a filter that is not brume's; in no total. */
  exchange?: number;
}

export interface Row {
  scene: string;
  spp: number;
  method: string;
  region: Region;
  metrics: Record<string, Estimate>;
  /** The same of direct and indirect light, where a method cleans them by themselves. */
  lights?: Record<string, Record<string, Estimate>>;
  parameters?: unknown;
  /** Searched parameters that ended on the edge of their candidates. */
  at_the_edge?: string[];
  seconds?: Seconds;
  peak_memory_bytes?: number | null;
  failed?: string | null;
}

/** All pairs of some methods by a metric: first with second, first with third, and so on. */
export interface Pairs {
  scene: string;
  spp: number;
  region: Region;
  metric: string;
  methods: string[];
  /** Of the 95 % interval of the paired difference. */
  half_width: number[];
  /** A letter for each pair: which of both is better beyond the noise of the seeds, "a", "b" or "-". */
  better: string;
}

/** Methods that no other one beats in both time and error. */
export interface Pareto {
  scene: string;
  region: Region;
  metric: string;
  /** Among the methods of this setting; empty: among all. */
  setting: string;
  front: { method: string; spp: number }[];
}

/** A method over all scenes and sample counts at once. */
export interface OverallMethod {
  method: string;
  value: number;
  times_less_than_noisy: number | null;
  /** Of guides and filter on a frame: mean, and most. */
  seconds: number;
  most_seconds: number;
  most_memory_bytes: number | null;
  guides: boolean;
  /** The methods behind it that the seeds cannot tell from it. */
  level_with: string[];
}

export interface Overall {
  region: Region;
  metric: string;
  /** Empty: all. */
  setting: string;
  scenes: string[];
  spp: number[];
  seeds: number;
  mean: "geometric" | "arithmetic";
  /** The best first. */
  methods: OverallMethod[];
  left_out: { method: string; why: string }[];
}

/** All methods at all errors that they reach, of a scene by one metric. */
export interface Times {
  scene: string;
  region: Region;
  metric: string;
  times: TimeToError[];
}

export interface TimeToError {
  method: string;
  error: number;
  seconds: number | null;
  factor_over_path_tracing?: number | null;
  factor_over_gradient_kernel?: number | null;
}

export interface Ablation {
  scene: string;
  spp: number;
  method: string;
  layer: string;
  how: "without" | "alone";
  region: Region;
  metrics: Record<string, Estimate>;
}

export interface Sensitivity {
  scene: string;
  spp: number;
  method: string;
  parameter: string;
  value: number | string;
  region: Region;
  metrics: Record<string, Estimate>;
}

/** A method on a sequence of frames, alone or with some on either side. */
export interface SequenceRow {
  spp: number;
  label: string;
  reach: number;
  region: Region;
  lab_rms?: Estimate;
  temporal_error?: Estimate;
  flicker?: Estimate;
  filter_seconds: number;
  failed?: string;
}

export interface Sequence {
  name: string;
  frames: number[];
  reference_change: Record<Region, number>;
  rows: SequenceRow[];
}

/** One embedded picture. */
export interface PictureEntry {
  scene: string;
  /** 0 for a reference. */
  spp: number;
  /** A method's id, or "reference". */
  method: string;
  width: number;
  height: number;
  /** Its samples lie in the element `picture-DATA`. */
  data: number;
}

export interface Results {
  brume?: string;
  commit?: string;
  command?: string;
  machine?: { cpu?: string; threads?: number } | string;
  /** How it was set up; `file` is the text of the experiment's file. */
  experiment?: { file?: string; [setting: string]: unknown };
  scenes: Scene[];
  spp: number[];
  seeds?: number[];
  metrics: Metric[];
  methods: Method[];
  rows: Row[];
  pairs: Pairs[];
  overall: Overall[];
  pareto: Pareto[];
  time_to_error: Times[];
  ablation: Ablation[];
  sensitivity: Sensitivity[];
  sequences: Sequence[];
}

export const REFERENCE = "reference";

/** Without what could not be measured: such a number is null in JSON. */
function measured<T extends { metrics: Record<string, Estimate> }>(entries: T[] | undefined): T[] {
  const there = ([, e]: [string, Estimate | null]) => e !== null && typeof e.mean === "number";
  return (entries ?? []).map((entry) => ({
    ...entry,
    metrics: Object.fromEntries(Object.entries(entry.metrics ?? {}).filter(there)),
  }));
}

/** Fills in the parts that may be missing. */
export function complete(raw: Partial<Results>): Results {
  return {
    ...raw,
    scenes: raw.scenes ?? [],
    spp: raw.spp ?? [],
    metrics: raw.metrics ?? [],
    methods: raw.methods ?? [],
    rows: measured(raw.rows),
    pairs: raw.pairs ?? [],
    overall: raw.overall ?? [],
    pareto: raw.pareto ?? [],
    time_to_error: raw.time_to_error ?? [],
    ablation: measured(raw.ablation),
    sensitivity: measured(raw.sensitivity),
    sequences: raw.sequences ?? [],
  };
}

/** Path tracing without a filter. */
export function isUnfiltered(method: Method): boolean {
  return !method.filter;
}

/** "searched", "default", ...; empty where a method has no such choice. */
export function settingOf(method: Method): string {
  return method.setting && method.setting !== "none" && !isUnfiltered(method) ? method.setting : "";
}

/** An object or text of parameters as pairs to print. */
export function listed(parameters: unknown): [string, string][] {
  if (parameters === null || parameters === undefined || parameters === "") return [];
  if (typeof parameters === "string")
    return parameters
      .split(/[,\s]+/)
      .filter(Boolean)
      .map(splitOnce);
  if (Array.isArray(parameters)) return parameters.map((entry) => [print(entry), ""]);
  if (typeof parameters === "object") return Object.entries(parameters).map(([key, value]) => [key, print(value)]);
  return [[String(parameters), ""]];
}

function splitOnce(word: string): [string, string] {
  const at = word.indexOf("=");
  return at < 0 ? [word, ""] : [word.slice(0, at), word.slice(at + 1)];
}

function print(value: unknown): string {
  return typeof value === "string" ? value : JSON.stringify(value);
}

/** Whether `x` is the better of two values of a metric. */
export function isBetter(metric: Metric, x: number, y: number): boolean {
  if (metric.better === "higher") return x > y;
  if (metric.better === "zero") return Math.abs(x) < Math.abs(y);
  return x < y;
}

export function totalSeconds(seconds: Seconds | undefined): number | undefined {
  if (!seconds || seconds.render === undefined) return undefined;
  return seconds.render + (seconds.guides ?? 0) + (seconds.filter ?? 0);
}

/** Look-up of rows, methods and verdicts by name. */
export class Index {
  readonly methods: Map<string, Method>;
  readonly metrics: Map<string, Metric>;
  private readonly rows: Map<string, Row>;
  private readonly pairs: Map<string, Pairs[]>;

  constructor(readonly results: Results) {
    this.methods = new Map(results.methods.map((m) => [m.id, m]));
    this.metrics = new Map(results.metrics.map((m) => [m.id, m]));
    this.rows = new Map(results.rows.map((r) => [key(r.scene, r.spp, r.method, r.region), r]));
    this.pairs = new Map();
    for (const p of results.pairs) {
      const at = key(p.scene, p.spp, p.region, p.metric);
      this.pairs.set(at, [...(this.pairs.get(at) ?? []), p]);
    }
  }

  row(scene: string, spp: number, method: string, region: Region): Row | undefined {
    return this.rows.get(key(scene, spp, method, region));
  }

  estimate(scene: string, spp: number, method: string, region: Region, metric: string): Estimate | undefined {
    return this.row(scene, spp, method, region)?.metrics[metric];
  }

  /** The paired difference `row - column`, and which of both is better beyond the noise of the seeds. */
  verdict(scene: string, spp: number, region: Region, metric: string, row: string, column: string) {
    for (const { methods, half_width, better } of this.pairs.get(key(scene, spp, region, metric)) ?? []) {
      const [r, c] = [methods.indexOf(row), methods.indexOf(column)];
      if (r < 0 || c < 0 || r === c) continue;
      const [first, second] = [Math.min(r, c), Math.max(r, c)];
      const at = first * methods.length - (first * (first + 1)) / 2 + (second - first - 1);
      const mean = (method: string) => this.estimate(scene, spp, method, region, metric)?.mean ?? NaN;
      const winner = better[at] === "a" ? first : better[at] === "b" ? second : -1;
      return {
        difference: mean(row) - mean(column),
        half_width: half_width[at]!,
        better: winner === r ? "row" : winner === c ? "column" : null,
      } as const;
    }
    return undefined;
  }

  /** The front of the methods of a setting, and whether a point lies on it. */
  isOnFront(scene: string, region: Region, metric: string, setting: string, method: string, spp: number): boolean {
    return this.results.pareto.some(
      (p) =>
        p.scene === scene &&
        p.region === region &&
        p.metric === metric &&
        p.setting === setting &&
        p.front.some((point) => point.method === method && point.spp === spp),
    );
  }

  times(scene: string, region: Region, metric: string): TimeToError[] {
    const same = (t: Times) => t.scene === scene && t.region === region && t.metric === metric;
    return this.results.time_to_error.find(same)?.times ?? [];
  }

  overall(region: Region, metric: string, setting: string): Overall | undefined {
    return this.results.overall.find((o) => o.region === region && o.metric === metric && o.setting === setting);
  }

  /** Whether methods are compared by a metric: a bias of zero is the best, of which differences tell nothing. */
  isPaired(metric: string): boolean {
    const found = this.metrics.get(metric);
    return found !== undefined && found.better !== "zero";
  }

  /** What a method ran with, which a search may have found for this scene and sample count alone. */
  parameters(scene: string, spp: number, method: string): [string, string][] {
    const row = this.row(scene, spp, method, "frame") ?? this.row(scene, spp, method, "medium");
    return listed(row?.parameters ?? this.methods.get(method)?.parameters);
  }

  /** The sample counts of a scene: frames of other renderers have their own. */
  spp(scene: string): number[] {
    const counts = new Set(this.results.rows.filter((r) => r.scene === scene).map((r) => r.spp));
    return counts.size ? [...counts].sort((x, y) => x - y) : this.results.spp;
  }

  /** The regions that this evaluation was measured over, the medium first. */
  regions(): Region[] {
    const there = new Set(this.results.rows.map((r) => r.region));
    return (["medium", "frame"] as const).filter((r) => there.has(r));
  }

  label(method: string): string {
    if (method === REFERENCE) return "reference";
    return this.methods.get(method)?.label ?? method;
  }

  /** The label, and the setting where another method bears the same label. */
  fullLabel(method: string): string {
    const m = this.methods.get(method);
    if (!m) return this.label(method);
    const setting = settingOf(m);
    const twins = this.results.methods.filter((other) => other.label === m.label).length > 1;
    return setting && twins ? `${m.label} (${setting})` : m.label;
  }
}

function key(...parts: (string | number)[]): string {
  return parts.join("\u0000");
}
