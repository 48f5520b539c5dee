// Every key and what it does: the help overlay is made from this list.
import { TONES } from "./color";
import type { PrintedKeys } from "./help";
import { ERROR_KINDS } from "./library";
import { REFERENCE } from "./results";
import { listedMethods, TABS, type Tab, type View } from "./state";
import type { Page } from "./context";
import { WHOLE } from "./viewport";

/** What keys can do beyond changing the view. */
export interface Actions {
  help: () => void;
  theme: () => void;
  link: () => void;
  zoom: (factor: number) => void;
  pan: (dx: number, dy: number) => void;
  actualSize: () => void;
  tabs: readonly Tab[];
}

interface Binding extends PrintedKeys {
  run: (page: Page, actions: Actions, key: string) => void;
}

function step<T>(list: readonly T[], now: T, by: number): T {
  const at = list.indexOf(now);
  return list[(at + by + list.length) % list.length] ?? now;
}

function stepMethod(page: Page, which: "a" | "b", by: number): void {
  const { index, library, view } = page;
  const there = [REFERENCE, ...listedMethods(index, view)].filter((id) => library.has(view.scene, view.spp, id));
  if (there.length)
    page.set({ [which]: step(there, view[which], by), ...(view.mode === "flip" ? { front: which } : {}) });
}

function tabKey(key: string, tab: Tab, what: string): Binding {
  return { keys: [key], what, run: (page, actions) => actions.tabs.includes(tab) && page.set({ tab }) };
}

const looking = (change: (view: View) => Partial<View>) => (page: Page) =>
  page.set({ tab: "look", ...change(page.view) });

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
      { keys: ["x"], what: "exchange A and B", run: (p) => p.set({ a: p.view.b, b: p.view.a }) },
      { keys: ["r"], what: "reference as A", run: (p) => p.set({ a: REFERENCE }) },
      { keys: ["1"], what: "swipe", run: looking(() => ({ mode: "swipe" })) },
      { keys: ["2"], what: "flip", run: looking(() => ({ mode: "flip" })) },
      { keys: ["3"], what: "grid", run: looking(() => ({ mode: "grid" })) },
      {
        keys: [" "],
        print: "Space",
        what: "flip to the other picture",
        run: looking((v) => (v.mode === "flip" ? { front: v.front === "a" ? "b" : "a" } : { mode: "flip" })),
      },
      {
        keys: ["ArrowLeft", "ArrowRight"],
        print: "← →",
        what: "move the divider",
        run: (p, _, k) => p.set({ split: p.view.split + (k === "ArrowRight" ? 0.02 : -0.02) }),
      },
    ],
  },
  {
    group: "Colours",
    bindings: [
      {
        keys: ["e"],
        what: "picture or error map",
        run: looking((v) => ({ show: v.show === "error" ? "picture" : "error" })),
      },
      {
        keys: ["k"],
        what: "next kind of error",
        run: looking((v) => ({ show: "error", error: step(ERROR_KINDS, v.error, 1), gain: 0 })),
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
        run: (p, _, k) => p.set({ stops: p.view.stops + (k === "]" ? 0.5 : -0.5) }),
      },
      { keys: ["\\"], what: "the scene's exposure", run: (p) => p.set({ stops: 0 }) },
      {
        keys: ["t"],
        what: "next tone curve",
        run: (p) => p.set({ tone: step(TONES, p.view.tone, 1), show: "picture" }),
      },
    ],
  },
  {
    group: "Zoom",
    bindings: [
      { keys: ["+", "="], print: "+", what: "closer", run: (_, a) => a.zoom(Math.SQRT2) },
      { keys: ["-"], what: "further", run: (_, a) => a.zoom(Math.SQRT1_2) },
      { keys: ["0"], what: "the whole picture", run: (p) => p.set({ ...WHOLE }) },
      { keys: ["o"], what: "one picture pixel for one of the screen", run: (_, a) => a.actualSize() },
      { keys: ["w"], print: "W A S D", what: "move the picture", run: (_, a) => a.pan(0, 1) },
      { keys: ["a"], print: "", what: "", run: (_, a) => a.pan(1, 0) },
      { keys: ["s"], print: "", what: "", run: (_, a) => a.pan(0, -1) },
      { keys: ["d"], print: "", what: "", run: (_, a) => a.pan(-1, 0) },
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
          p.set({
            scene: step(
              p.index.results.scenes.map((s) => s.name),
              p.view.scene,
              1,
            ),
          }),
      },
      {
        keys: ["f"],
        what: "medium or whole frame",
        run: (p) => p.set({ region: step(p.index.regions(), p.view.region, 1) }),
      },
      {
        keys: ["c"],
        what: "next metric",
        run: (p) =>
          p.set({
            metric: step(
              p.index.results.metrics.map((m) => m.id),
              p.view.metric,
              1,
            ),
          }),
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

function stepGain(page: Page, by: number): void {
  page.set({ tab: "look", show: "error", gain: page.view.gain + by });
}

function stepSpp(page: Page, by: number): void {
  const spp = page.index.spp(page.view.scene);
  const at = spp.indexOf(page.view.spp) + by;
  if (at >= 0 && at < spp.length) page.set({ spp: spp[at]! });
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
        binding.run(page, actions, key);
        return;
      }
}
