// How the page shows things: kept while its tab lives, as are the assignments, and not part of undo.
import { TONES, type Tone } from "../color";
import { NONE, type Assignments, type Value } from "./assignments";

/** "display": that of the program's OpenColorIO configuration, where it has one, else sRGB. */
export type ViewTone = Tone | "display";

export interface Settings {
  /** The layer shown, and the one right of the divider; empty: none. */
  layer: string;
  other: string;
  /** The divider's place, 0 to 1 of the picture's width. */
  split: number;
  tone: ViewTone;
  /** Exposure beside the scene's own. */
  stops: number;
  /** Picture pixels for each device pixel; 0: one, but at most WIDEST columns. */
  resolution: number;
  /** Whether the panels are seen. */
  panels: boolean;
  /** Panels that were opened or closed by hand. */
  open: Readonly<Record<string, boolean>>;
}

export const WIDEST = 1280;
/** Side of a picture that the program still makes [px]. */
const LARGEST = 4096;

export const DEFAULTS: Settings = {
  layer: "picture",
  other: "",
  split: 0.5,
  tone: "display",
  stops: 0,
  resolution: 0,
  panels: true,
  open: {},
};

interface Kept {
  settings: Partial<Settings>;
  assignments: [string, Value][];
}

const place = () => `brume view ${location.pathname}`;

/** What this tab had before the page was loaded again. */
export function restore(): { settings: Settings; assignments: Assignments } {
  try {
    const kept = JSON.parse(sessionStorage.getItem(place()) ?? "") as Kept;
    const settings = { ...DEFAULTS, ...kept.settings };
    if (settings.tone !== "display" && !TONES.includes(settings.tone)) settings.tone = DEFAULTS.tone;
    return { settings, assignments: new Map(kept.assignments) };
  } catch {
    return { settings: DEFAULTS, assignments: NONE };
  }
}

export function keep(settings: Settings, assignments: Assignments): void {
  try {
    sessionStorage.setItem(place(), JSON.stringify({ settings, assignments: [...assignments] } satisfies Kept));
  } catch {
    // A browser may refuse to keep anything: the page then starts anew when it is loaded again.
  }
}

/** Columns and rows to ask for. @param area  room in CSS pixels  @param ratio  device pixels for each */
export function pictureSize(
  area: { width: number; height: number },
  ratio: number,
  resolution: number,
): [number, number] {
  const { width, height } = area;
  const factor = resolution > 0 ? resolution * ratio : Math.min(ratio, WIDEST / width);
  const pixels = (length: number) => Math.min(LARGEST, Math.max(16, Math.round(length * factor)));
  return [pixels(width), pixels(height)];
}
