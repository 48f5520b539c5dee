// Every key and what it does: the help overlay is made from this list.
import type { PrintedKeys } from "../help";
import { addLamp, focusAt, frameBounds, moveByKey, resetCamera, toggleSunTool, turnSun } from "./actions";
import { dolly, orbit, pan, seenFrom, zoom } from "./camera";
import type { Viewer } from "./viewer";

export interface Commands {
  help: () => void;
}

interface Binding extends PrintedKeys {
  run: (viewer: Viewer, key: string, commands: Commands) => void;
}

const ANGLE = Math.PI / 36;
const WAYS: Record<string, [right: number, up: number]> = {
  ArrowLeft: [-1, 0],
  ArrowRight: [1, 0],
  ArrowUp: [0, 1],
  ArrowDown: [0, -1],
};
const ARROWS = Object.keys(WAYS);

function arrow(viewer: Viewer, key: string): void {
  const [right, up] = WAYS[key]!;
  if (viewer.tool === "sun") viewer.nudge(() => turnSun(viewer, right * ANGLE, -up * ANGLE, "key"));
  else moveByKey(viewer, (c) => orbit(c, right * ANGLE, up * ANGLE));
}

export const BINDINGS: { group: string; bindings: Binding[] }[] = [
  {
    group: "Camera",
    bindings: [
      { keys: ARROWS, print: "← → ↑ ↓", what: "orbit, or turn the sun with its tool", run: (v, key) => arrow(v, key) },
      {
        keys: ARROWS.map((key) => `Shift+${key}`),
        print: "Shift + ← → ↑ ↓",
        what: "pan",
        run: (v, key) => {
          const [right, up] = WAYS[key.slice(6)]!;
          moveByKey(v, (c) => pan(c, 0.05 * right, 0.05 * up, v.aspect));
        },
      },
      { keys: ["+", "="], print: "+", what: "closer", run: (v) => moveByKey(v, (c) => dolly(c, 0.9)) },
      { keys: ["-"], what: "further away", run: (v) => moveByKey(v, (c) => dolly(c, 1 / 0.9)) },
      {
        keys: ["<", ">"],
        print: "< >",
        what: "narrower, wider angle of view",
        run: (v, key) => moveByKey(v, (c) => zoom(c, key === "<" ? 0.9 : 1 / 0.9)),
      },
      { keys: ["1"], what: "from the front", run: (v) => v.moveCamera((c) => seenFrom(c, "front")) },
      { keys: ["2"], what: "from the side", run: (v) => v.moveCamera((c) => seenFrom(c, "side")) },
      { keys: ["3"], what: "from above", run: (v) => v.moveCamera((c) => seenFrom(c, "top")) },
      { keys: ["f"], what: "show all of the volumes", run: frameBounds },
      { keys: ["0", "Home"], print: "0 Home", what: "the file's camera", run: resetCamera },
      { keys: ["c"], what: "look at what is in the middle", run: (v) => void focusAt(v, 0.5, 0.5) },
    ],
  },
  {
    group: "Light",
    bindings: [
      { keys: ["l"], what: "sun tool: drags turn the sun", run: toggleSunTool },
      {
        keys: ["a"],
        what: "add a lamp where the picture is clicked next",
        run: (v) => v.use(v.tool === "lamp" ? "camera" : "lamp"),
      },
      {
        keys: ["Enter"],
        print: "Enter",
        what: "with the lamp tool: put it in the middle",
        run: (v) => v.tool === "lamp" && void addLamp(v, 0.5, 0.5),
      },
      { keys: ["Escape"], print: "Esc", what: "back to the camera", run: (v) => v.use("camera") },
    ],
  },
  {
    group: "Picture",
    bindings: [
      {
        keys: ["[", "]"],
        print: "[ ]",
        what: "half a stop darker, brighter",
        run: (v, key) => v.set({ stops: Math.min(16, Math.max(-16, v.settings.stops + (key === "]" ? 0.5 : -0.5))) }),
      },
      { keys: ["\\"], what: "the scene's exposure", run: (v) => v.set({ stops: 0 }) },
      {
        keys: ["t"],
        what: "next tone curve",
        run: (v) => v.set({ tone: v.tones[(v.tones.findIndex((t) => t.value === v.tone) + 1) % v.tones.length]!.value }),
      },
      { keys: ["v"], what: "next layer", run: nextLayer },
      { keys: ["p"], what: "show or hide the panels", run: (v) => v.set({ panels: !v.settings.panels }) },
    ],
  },
  {
    group: "Sequence",
    bindings: [
      { keys: [" "], print: "Space", what: "play or pause", run: (v) => v.togglePlay() },
      {
        keys: [",", "."],
        print: ", .",
        what: "previous, next frame",
        run: (v, key) => v.stepFrame(key === "." ? 1 : -1),
      },
    ],
  },
  {
    group: "Changes",
    bindings: [
      { keys: ["Ctrl+z"], print: "Ctrl + Z", what: "undo", run: (v) => v.undo() },
      { keys: ["Ctrl+Shift+z", "Ctrl+y"], print: "Ctrl + Shift + Z", what: "redo", run: (v) => v.redo() },
      { keys: ["?", "h"], print: "?", what: "these keys", run: (_v, _k, commands) => commands.help() },
    ],
  },
];

function nextLayer(viewer: Viewer): void {
  const names = viewer.scene?.layers.map(({ name }) => name) ?? [];
  const next = names[(names.indexOf(viewer.settings.layer) + 1) % names.length];
  if (next) viewer.set({ layer: next });
}

/** Whether a key belongs to what has the keyboard, as arrows to a slider. */
function isTaken(target: HTMLElement, key: string): boolean {
  if (target.closest("input[type=text], select, textarea, dialog[open]")) return true;
  if (key.startsWith("Ctrl+")) return false;
  const arrow = /Arrow|Home|End|Page/.test(key);
  if (arrow) return !!target.closest("input[type=range], input[type=color], [role=separator]");
  return (key === " " || key === "Enter") && !!target.closest("button, a, input:not([type=range])");
}

/** Runs what an event's key stands for. */
export function handleKey(event: KeyboardEvent, viewer: Viewer, commands: Commands): void {
  if (event.altKey || event.isComposing) return;
  const letter = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  const control = event.ctrlKey || event.metaKey;
  const shifted = event.shiftKey && (control || letter.startsWith("Arrow"));
  const key = `${control ? "Ctrl+" : ""}${shifted ? "Shift+" : ""}${letter}`;
  if (isTaken(event.target as HTMLElement, key)) return;
  for (const { bindings } of BINDINGS)
    for (const binding of bindings)
      if (binding.keys.includes(key)) {
        event.preventDefault();
        binding.run(viewer, key, commands);
        return;
      }
}
