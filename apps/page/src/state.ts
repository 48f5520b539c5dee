// What is seen, and its place in the address: a link with the same hash shows the same.
import { TONES, type Tone } from "./color";
import { ERROR_KINDS, type ErrorKind, type Library } from "./library";
import { isUnfiltered, REFERENCE, settingOf, type Index, type Region } from "./results";
import { WHOLE, type Viewport } from "./viewport";

export const TABS = ["look", "numbers", "plots", "ablation", "sensitivity", "about"] as const;
export type Tab = (typeof TABS)[number];
export const MODES = ["swipe", "flip", "grid"] as const;
export type Mode = (typeof MODES)[number];
export const SHOWS = ["picture", "error", "difference"] as const;
export type Show = (typeof SHOWS)[number];

export interface View extends Viewport {
  tab: Tab;
  scene: string;
  spp: number;
  region: Region;
  metric: string;
  /** The two pictures that are compared: ids of methods, or the reference. */
  a: string;
  b: string;
  mode: Mode;
  /** Which one is in front where they are flipped. */
  front: "a" | "b";
  /** Where the divider of the swipe stands, 0 to 1 of the pane's width. */
  split: number;
  /** Pictures, their errors, or A minus B. */
  show: Show;
  error: ErrorKind;
  /** Doublings of the value at the end of the error colours. */
  gain: number;
  /** Exposure in stops beside the scene's own. */
  stops: number;
  tone: Tone;
  /** How parameters were chosen: only methods of this setting are listed; empty: all. */
  setting: string;
  /** Methods left out of grid, plots and tables. */
  hidden: readonly string[];
  sort: string;
  descending: boolean;
}

export const SETTING_ORDER = ["searched", "default", "paper", "transfer"];

export function settings(index: Index): string[] {
  const all = [...new Set(index.results.methods.map(settingOf))].filter((s) => s !== "");
  const rank = (s: string) => (SETTING_ORDER.indexOf(s) + SETTING_ORDER.length + 1) % (SETTING_ORDER.length + 1);
  return all.sort((x, y) => rank(x) - rank(y));
}

export function defaultView(index: Index, library: Library): View {
  const { scenes, metrics } = index.results;
  const setting = settings(index)[0] ?? "";
  const scene = scenes[0]?.name ?? "";
  const region = index.regions()[0] ?? "frame";
  const metric = metrics[0]?.id ?? "";
  const view: View = {
    ...WHOLE,
    tab: "look",
    scene,
    spp: index.spp(scene)[0] ?? 0,
    region,
    metric,
    a: "",
    b: "",
    mode: "swipe",
    front: "b",
    split: 0.5,
    show: "picture",
    error: "lab",
    gain: 0,
    stops: 0,
    tone: "srgb",
    setting,
    hidden: [],
    sort: metric,
    descending: false,
  };
  const listed = listedMethods(index, view);
  const noisy = listed.find((id) => isUnfiltered(index.methods.get(id)!));
  const best = listed.find((id) => id !== noisy && library.has(scene, view.spp, id));
  view.a = noisy ?? REFERENCE;
  view.b = best ?? noisy ?? REFERENCE;
  return view;
}

/** The methods of the chosen setting, the best first; unfiltered path tracing belongs to every setting. */
export function listedMethods(
  index: Index,
  view: Pick<View, "setting" | "scene" | "spp" | "region" | "metric">,
): string[] {
  const metric = index.metrics.get(view.metric);
  const rank = (id: string) => {
    const value = index.estimate(view.scene, view.spp, id, view.region, view.metric)?.mean;
    if (value === undefined || value === null || Number.isNaN(value)) return Infinity;
    return metric?.better === "higher" ? -value : metric?.better === "zero" ? Math.abs(value) : value;
  };
  return index.results.methods
    .filter((m) => view.setting === "" || settingOf(m) === "" || settingOf(m) === view.setting)
    .map((m) => m.id)
    .sort((x, y) => rank(x) - rank(y) || 0);
}

/** A method's name, with its setting only where methods of several settings are listed. */
export function nameIn(index: Index, view: View, id: string): string {
  const method = index.methods.get(id);
  return method && view.setting !== "" && settingOf(method) === view.setting ? method.label : index.fullLabel(id);
}

export function shownMethods(index: Index, view: View): string[] {
  return listedMethods(index, view).filter((id) => !view.hidden.includes(id));
}

/** The best of the shown methods by the metric that is looked at, where one has a value. */
export function bestShown(index: Index, view: View): string | undefined {
  const of = (id: string) => index.estimate(view.scene, view.spp, id, view.region, view.metric);
  return shownMethods(index, view).find((id) => of(id) !== undefined);
}

/** The shown methods of which there are entries; where it is none of them, as with other parameters, all there are. */
export function measuredMethods(index: Index, view: View, entries: readonly { method: string }[]): string[] {
  const there = new Set(entries.map((e) => e.method));
  const shown = shownMethods(index, view).filter((id) => there.has(id));
  return shown.length
    ? shown
    : listedMethods(index, { ...view, setting: "" }).filter((id) => there.has(id) && !view.hidden.includes(id));
}

/** Of the sample counts that were measured the one closest to the chosen one. */
export function nearest(counts: readonly number[], spp: number): number {
  return [...counts].sort((x, y) => Math.abs(Math.log(x / spp)) - Math.abs(Math.log(y / spp)))[0] ?? spp;
}

const within = (value: number, low: number, high: number) => Math.min(high, Math.max(low, value));

/** The view with a sample count that its scene has, and numbers in their ranges. */
export function fitting(index: Index, view: View): View {
  const counts = index.spp(view.scene);
  return {
    ...view,
    spp: counts.includes(view.spp) ? view.spp : nearest(counts, view.spp),
    split: within(view.split, 0, 1),
    gain: within(view.gain, -8, 8),
    stops: within(view.stops, -12, 12),
  };
}

function short(value: number): string {
  return String(Number(value.toFixed(4)));
}

/** What differs from the default, as the hash of a link. */
export function toHash(view: View, normal: View): string {
  const words = new URLSearchParams();
  for (const name of Object.keys(normal) as (keyof View)[]) {
    const value = view[name];
    const text = Array.isArray(value) ? value.join("|") : typeof value === "number" ? short(value) : String(value);
    const other = normal[name];
    const usual = Array.isArray(other) ? other.join("|") : typeof other === "number" ? short(other) : String(other);
    if (text !== usual) words.set(name, text);
  }
  return words.toString();
}

/** The view of a hash; words that mean nothing here are passed over. */
export function fromHash(hash: string, normal: View, index: Index): View {
  const words = new URLSearchParams(hash.replace(/^#/, ""));
  const view: View = { ...normal };
  const one = <T extends string>(name: string, among: readonly T[], set: (value: T) => void) => {
    const word = words.get(name);
    const found = among.find((a) => a === word);
    if (found !== undefined) set(found);
  };
  const real = (name: string, low: number, high: number, set: (value: number) => void) => {
    const word = words.get(name);
    const value = word === null || word === "" ? NaN : Number(word);
    if (value >= low && value <= high) set(value);
  };
  const { scenes, metrics, methods } = index.results;
  const pictures = [REFERENCE, ...methods.map((m) => m.id)];
  one("tab", TABS, (v) => (view.tab = v));
  one(
    "scene",
    scenes.map((s) => s.name),
    (v) => (view.scene = v),
  );
  real("spp", 0, 1e9, (v) => (view.spp = v));
  one("region", index.regions(), (v) => (view.region = v));
  one(
    "metric",
    metrics.map((m) => m.id),
    (v) => (view.metric = v),
  );
  one("a", pictures, (v) => (view.a = v));
  one("b", pictures, (v) => (view.b = v));
  one("mode", MODES, (v) => (view.mode = v));
  one("front", ["a", "b"], (v) => (view.front = v));
  one("show", SHOWS, (v) => (view.show = v));
  one("error", ERROR_KINDS, (v) => (view.error = v));
  one("tone", TONES, (v) => (view.tone = v));
  one("setting", ["", ...settings(index)], (v) => (view.setting = v));
  real("split", 0, 1, (v) => (view.split = v));
  real("gain", -8, 8, (v) => (view.gain = Math.round(v)));
  real("stops", -12, 12, (v) => (view.stops = v));
  real("x", 0, 1, (v) => (view.x = v));
  real("y", 0, 1, (v) => (view.y = v));
  real("zoom", 0.125, 64, (v) => (view.zoom = v));
  view.hidden = (words.get("hidden") ?? "").split("|").filter((id) => index.methods.has(id));
  view.sort = words.get("sort") ?? normal.sort;
  view.descending = words.get("descending") === "true";
  return fitting(index, view);
}
