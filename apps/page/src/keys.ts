// Every key and what it does: the help overlay is made from this list.
import { TONES } from "./color";
import type { PrintedKeys } from "./help";
import { ERROR_KINDS } from "./library";
import { REFERENCE } from "./results";
import { showing } from "./look";
import { listedMethods, TABS, type Tab, type View } from "./state";
import type { Page } from "./context";
import { showsAll, WHOLE } from "./viewport";

/** What keys can do beyond changing the view. Those of the picture say whether anything has changed. */
export interface Actions {
  help: () => void;
  theme: () => void;
  link: () => void;
  zoom: (factor: number) => boolean;
  pan: (dx: number, dy: number) => boolean;
  actualSize: () => boolean;
  tabs: readonly Tab[];
  /** Tells the reader why a key did nothing. */
  notice: (why: string) => void;
}

interface Binding extends PrintedKeys {
  /** What it does; where that is nothing now, the words why. */
  run: (page: Page, actions: Actions, key: string) => string | void;
}

function step<T>(list: readonly T[], now: T, by: number): T {
  const at = list.indexOf(now);
  return list[(at + by + list.length) % list.length] ?? now;
}

const LOOK = "L goes to the pictures";

function stepMethod(page: Page, which: "a" | "b", by: number): string | void {
  const { index, library, view } = page;
  const there = [REFERENCE, ...listedMethods(index, view)].filter((id) => library.has(view.scene, view.spp, id));
  const next = step(there, view[which], by);
  if (there.length === 0 || next === view[which]) return "There is no other picture of this scene and sample count";
  page.set({ [which]: next, ...(view.mode === "flip" ? { front: which } : {}) });
}

const ABSENT: Partial<Record<Tab, string>> = {
  ablation: "No layer was left out in this evaluation: ablation = true in the experiment's file measures that",
  sensitivity: "No parameter was varied in this evaluation: sensitivity = true in the experiment's file measures that",
};

function tabKey(key: string, tab: Tab, what: string): Binding {
  return {
    keys: [key],
    what,
    run: (page, actions) => {
      if (!actions.tabs.includes(tab)) return ABSENT[tab] ?? "This evaluation has no numbers";
      if (page.view.tab === tab) return `This is ${tab}`;
      page.set({ tab });
    },
  };
}

const looking = (change: (view: View) => Partial<View>) => (page: Page) =>
  page.set({ tab: "look", ...change(page.view) });

/** A key of one of the ways to compare. */
function modeKey(key: string, mode: View["mode"]): Binding {
  return {
    keys: [key],
    what: mode,
    run: (page) => {
      const { view } = page;
      page.set({ tab: "look", mode });
      if (view.show === "difference" && mode !== "grid") return "A minus B is one picture: G goes back to the two";
      if (view.tab === "look" && view.mode === mode) return `This is ${mode}`;
    },
  };
}

/** The exposure is of pictures: not of error maps, and not of tables. */
function stepStops(page: Page, by: number): string | void {
  const { view } = page;
  if (view.tab !== "look") return `Exposure is of the pictures: ${LOOK}`;
  if (view.show !== "picture") return "Exposure does not change error maps: E or G goes back to the pictures";
  if (by ? Math.abs(view.stops + by) > 12 : view.stops === 0)
    return by ? "12 stops are the most" : "This is the scene's exposure";
  page.set({ stops: by ? view.stops + by : 0 });
}

/** What moves or scales pictures. */
const ofPictures =
  (change: (actions: Actions) => boolean, otherwise: string) =>
  (page: Page, actions: Actions): string | void => {
    if (page.view.tab !== "look") return `Zoom is of the pictures: ${LOOK}`;
    if (!change(actions)) return otherwise;
  };

const moving = (dx: number, dy: number) => (page: Page, actions: Actions) => {
  if (page.view.tab === "look" && showsAll(page.view)) return "All of the picture is seen: + comes closer";
  return ofPictures((a) => a.pan(dx, dy), "Here the picture ends")(page, actions);
};

/** The next of a list by which all is judged. */
function turn<T>(list: readonly T[], now: T, single: string, use: (next: T) => void): string | void {
  if (list.length < 2) return single;
  use(step(list, now, 1));
}

export const BINDINGS: { group: string; bindings: Binding[] }[] = [
  {
    group: "Pictures",
    bindings: [
      {
        keys: ["ArrowDown", "ArrowUp"],
        print: "↓ ↑",
        what: "next, previous method as B",
        run: (p, _, k) => stepMethod(p, "b", k === "ArrowDown" ? 1 : -1),
      },
      {
        keys: ["Shift+ArrowDown", "Shift+ArrowUp"],
        print: "Shift + ↓ ↑",
        what: "next, previous method as A",
        run: (p, _, k) => stepMethod(p, "a", k === "Shift+ArrowDown" ? 1 : -1),
      },
      {
        keys: ["x"],
        what: "exchange A and B",
        run: (p) => (p.view.a === p.view.b ? "A and B are the same" : p.set({ a: p.view.b, b: p.view.a })),
      },
      {
        keys: ["r"],
        what: "reference as A",
        run: (p) => (p.view.a === REFERENCE ? "A is the reference" : p.set({ a: REFERENCE })),
      },
      modeKey("1", "swipe"),
      modeKey("2", "flip"),
      modeKey("3", "grid"),
      {
        keys: [" "],
        print: "Space",
        what: "flip to the other picture",
        run: (p) => {
          const { view } = p;
          if (view.tab === "look" && view.show === "difference" && view.mode !== "grid")
            return "A minus B is one picture: G goes back to the two";
          if (view.a === view.b) return "A and B are the same";
          looking((v) => (v.mode === "flip" ? { front: v.front === "a" ? "b" : "a" } : { mode: "flip" }))(p);
        },
      },
      {
        keys: ["ArrowLeft", "ArrowRight"],
        print: "← →",
        what: "move the divider",
        run: (p, _, k) => {
          const { view } = p;
          const by = k === "ArrowRight" ? 0.02 : -0.02;
          if (view.mode !== "swipe") return "The divider is of swipe: 1 goes there";
          if (view.show === "difference") return "A minus B has no divider: G goes back to the two pictures";
          if (view.split + by < -0.019 || view.split + by > 1.019) return "The divider is at the edge";
          p.set({ split: view.split + by });
        },
      },
    ],
  },
  {
    group: "Colours",
    bindings: [
      {
        keys: ["e"],
        what: "picture or error map",
        run: (p) => {
          const { view } = p;
          looking((v) => ({ show: v.show === "error" ? "picture" : "error" }))(p);
          if (view.show !== "error" && view.a === REFERENCE && view.b === REFERENCE && view.mode !== "grid")
            return "A and B are the reference, which has no error";
        },
      },
      {
        keys: ["g"],
        what: "A minus B; in the grid A minus each",
        run: (p) => {
          const { view } = p;
          looking((v) => showing(v.show === "difference" ? "picture" : "difference"))(p);
          if (view.show !== "difference" && view.a === view.b && view.mode !== "grid")
            return "A and B are the same: nothing is left";
        },
      },
      {
        keys: ["k"],
        what: "next kind of error",
        run: looking((v) => ({
          show: v.show === "difference" ? "difference" : "error",
          error: step(ERROR_KINDS, v.error, 1),
          gain: 0,
        })),
      },
      {
        keys: ["<", ">"],
        print: "< >",
        what: "halve, double the error scale",
        run: (p, _, k) => stepGain(p, k === ">" ? 1 : -1),
      },
      {
        keys: ["[", "]"],
        print: "[ ]",
        what: "half a stop darker, brighter",
        run: (p, _, k) => stepStops(p, k === "]" ? 0.5 : -0.5),
      },
      { keys: ["\\"], what: "the scene's exposure", run: (p) => stepStops(p, 0) },
      {
        keys: ["t"],
        what: "next tone curve",
        run: looking((v) => ({ tone: step(TONES, v.tone, 1), show: "picture" })),
      },
    ],
  },
  {
    group: "Zoom",
    bindings: [
      {
        keys: ["+", "="],
        print: "+",
        what: "closer",
        run: ofPictures((a) => a.zoom(Math.SQRT2), "This is as close as it gets"),
      },
      { keys: ["-"], what: "further", run: ofPictures((a) => a.zoom(Math.SQRT1_2), "This is as far as it gets") },
      {
        keys: ["0"],
        what: "the whole picture",
        run: (p) => {
          const { view } = p;
          if (view.tab !== "look") return `Zoom is of the pictures: ${LOOK}`;
          if (view.zoom === WHOLE.zoom && view.x === WHOLE.x && view.y === WHOLE.y) return "All of the picture is seen";
          p.set({ ...WHOLE });
        },
      },
      {
        keys: ["o"],
        what: "one picture pixel for one of the screen",
        run: ofPictures((a) => a.actualSize(), "The picture has its own size"),
      },
      { keys: ["w"], print: "W A S D", what: "move the picture", run: moving(0, 1) },
      { keys: ["a"], print: "", what: "", run: moving(1, 0) },
      { keys: ["s"], print: "", what: "", run: moving(0, -1) },
      { keys: ["d"], print: "", what: "", run: moving(-1, 0) },
    ],
  },
  {
    group: "Data",
    bindings: [
      {
        keys: [",", "."],
        print: ", .",
        what: "fewer, more samples per pixel",
        run: (p, _, k) => stepSpp(p, k === "." ? 1 : -1),
      },
      {
        keys: ["m"],
        what: "next scene",
        run: (p) =>
          turn(
            p.index.results.scenes.map((s) => s.name),
            p.view.scene,
            "There is one scene only",
            (scene) => p.set({ scene }),
          ),
      },
      {
        keys: ["f"],
        what: "medium or whole frame",
        run: (p) =>
          turn(
            p.index.regions(),
            p.view.region,
            `Errors were taken over ${p.index.regions()[0] === "medium" ? "the medium" : "the whole frame"} only`,
            (region) => p.set({ region }),
          ),
      },
      {
        keys: ["c"],
        what: "next metric",
        run: (p) =>
          turn(
            p.index.results.metrics.map((m) => m.id),
            p.view.metric,
            "There is one metric only",
            (metric) => p.set({ metric }),
          ),
      },
    ],
  },
  {
    group: "Page",
    bindings: [
      tabKey("l", "look", "look"),
      tabKey("n", "numbers", "numbers"),
      tabKey("p", "plots", "plots"),
      tabKey("b", "ablation", "ablation"),
      tabKey("v", "sensitivity", "sensitivity"),
      tabKey("i", "about", "about: versions, parameters, metrics"),
      { keys: ["y"], what: "copy a link to this view", run: (_, a) => a.link() },
      { keys: ["u"], what: "light or dark", run: (_, a) => a.theme() },
      { keys: ["?", "h"], print: "?", what: "these keys", run: (_, a) => a.help() },
    ],
  },
];

function stepGain(page: Page, by: number): string | void {
  const { view } = page;
  const show = view.show === "difference" ? "difference" : "error";
  page.set({ tab: "look", show, gain: view.gain + by });
  if (Math.abs(view.gain + by) > 8)
    return by > 0 ? "The scale is as long as it gets" : "The scale is as short as it gets";
}

function stepSpp(page: Page, by: number): string | void {
  const spp = page.index.spp(page.view.scene);
  const at = spp.indexOf(page.view.spp) + by;
  if (at < 0 || at >= spp.length)
    return `${page.view.scene} was evaluated at ${spp.join(", ")} samples per pixel, no ${by > 0 ? "more" : "fewer"}`;
  page.set({ spp: spp[at]! });
}

export function tabsOf(page: Pick<Page, "index">): Tab[] {
  const { ablation, sensitivity, rows } = page.index.results;
  return TABS.filter((tab) => {
    if (tab === "ablation") return ablation.length > 0;
    if (tab === "sensitivity") return sensitivity.length > 0;
    if (tab === "plots" || tab === "numbers") return rows.length > 0;
    return true;
  });
}

/** Runs what an event's key stands for. */
export function handleKey(event: KeyboardEvent, page: Page, actions: Actions): void {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  // A closed dialog keeps the keyboard until the next drawing: its keys are the page's.
  const focused = event.target as HTMLElement;
  const target = focused.closest("dialog:not([open])") ? document.body : focused;
  if (target.closest("input:not([type=checkbox]), select, textarea, dialog")) return;
  if ((event.key === " " || event.key === "Enter") && target.closest("button, a, input, summary")) return;
  if (event.key.startsWith("Arrow") && target.closest("[role=tablist], [role=separator]")) return;
  if (event.key.startsWith("Arrow") && page.view.tab !== "look") return;
  const letter = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  const key = event.shiftKey && letter.startsWith("Arrow") ? `Shift+${letter}` : letter;
  for (const { bindings } of BINDINGS)
    for (const binding of bindings)
      if (binding.keys.includes(key)) {
        event.preventDefault();
        const why = binding.run(page, actions, key);
        if (why) actions.notice(why);
        return;
      }
}
