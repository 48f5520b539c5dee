import { useEffect, useMemo, useRef } from "preact/hooks";
import { Help } from "../help";
import { toggleSunTool } from "./actions";
import { useViewer, ViewerProvider } from "./context";
import { Icon } from "./icons";
import { BINDINGS, handleKey } from "./keys";
import { Panels } from "./panels";
import { Stage } from "./stage";
import { Status } from "./status";
import { Timeline } from "./timeline";
import { Viewer } from "./viewer";

const POINTER_NOTE =
  "With a pointer: a drag turns the camera about the point it looks at, with Shift or the right button it moves it; the wheel goes closer, with Ctrl it changes the angle of view; a double click looks at what is there. With fingers: one turns, two move and pinch.";

export function App() {
  const viewer = useMemo(() => new Viewer(new URL("live", location.href).href.replace(/^http/, "ws")), []);
  return (
    <ViewerProvider value={viewer}>
      <Page />
    </ViewerProvider>
  );
}

function Page() {
  const viewer = useViewer();
  const help = useRef<HTMLDialogElement>(null);
  const openHelp = () => !help.current!.open && help.current!.showModal();
  const { scene, settings, history, tool, frame } = viewer;

  useEffect(() => {
    const key = (event: KeyboardEvent) => handleKey(event, viewer, { help: openHelp });
    addEventListener("keydown", key);
    return () => removeEventListener("keydown", key);
  }, []);
  useEffect(() => {
    document.title = scene ? `${scene.name}${frame === null ? "" : ` ${frame}`} – brume` : "brume";
  }, [scene?.name, frame]);
  // A page that is looked at again takes the turn back that another one has.
  useEffect(() => {
    const back = () => document.visibilityState === "visible" && viewer.resume();
    addEventListener("focus", back);
    document.addEventListener("visibilitychange", back);
    return () => {
      removeEventListener("focus", back);
      document.removeEventListener("visibilitychange", back);
    };
  }, []);

  return (
    <div class={`viewer${settings.panels ? "" : " wide"}`}>
      <header class="top">
        <h1>
          <svg viewBox="0 0 32 32" aria-hidden="true">
            <path d="M4 11c5-5 9 3 14 0s6-4 10-2M3 18c6-5 10 3 15 0s7-4 11-2M7 25c5-4 8 2 12 0s5-3 8-2" />
          </svg>
          <span class="name">{scene?.name ?? "brume"}</span>
        </h1>
        <div class="tools" role="group" aria-label="Tools" hidden={viewer.ofFrames}>
          <button
            type="button"
            aria-pressed={tool === "sun"}
            title="Drags turn the sun (L)"
            onClick={() => toggleSunTool(viewer)}
          >
            <Icon name="sun" /> <span class="text">Sun</span>
          </button>
          <button
            type="button"
            aria-pressed={tool === "lamp"}
            title="The next click on the picture puts a lamp there (A)"
            onClick={() => viewer.use(tool === "lamp" ? "camera" : "lamp")}
          >
            <Icon name="lamp" /> <span class="text">Add lamp</span>
          </button>
        </div>
        <div class="tools" role="group" aria-label="Changes">
          <button
            type="button"
            class="icon"
            disabled={!history.canUndo}
            title="Undo (Ctrl+Z)"
            aria-label="Undo"
            onClick={() => viewer.undo()}
          >
            <Icon name="undo" />
          </button>
          <button
            type="button"
            class="icon"
            disabled={!history.canRedo}
            title="Redo (Ctrl+Shift+Z)"
            aria-label="Redo"
            onClick={() => viewer.redo()}
          >
            <Icon name="redo" />
          </button>
          <button
            type="button"
            disabled={!viewer.assignments.size}
            title={viewer.ofFrames ? "Lights as they are in the frame" : "The scene as its file has it"}
            onClick={() => viewer.resetAll()}
          >
            Reset all
          </button>
        </div>
        <div class="tools end">
          <button
            type="button"
            class="icon"
            aria-pressed={settings.panels}
            title="Panels (P)"
            aria-label="Panels"
            onClick={() => viewer.set({ panels: !settings.panels })}
          >
            <Icon name="panels" />
          </button>
          <button type="button" class="icon" title="Keys (?)" aria-label="Keys" onClick={openHelp}>
            ?
          </button>
        </div>
      </header>
      <main>
        <Stage />
        <Alerts />
      </main>
      {settings.panels && <Panels />}
      <footer>
        <Timeline />
        <Status />
      </footer>
      <div class="message" role="status">
        {viewer.said}
      </div>
      <Help dialog={help} groups={BINDINGS} note={POINTER_NOTE} />
    </div>
  );
}

/** The grids of a file in which none could be taken: a click takes one. */
function Grids() {
  const viewer = useViewer();
  const { grids, grid_key } = viewer.problem ?? {};
  if (!grids?.length || !grid_key) return null;
  return (
    <>
      <p>{grids.some(({ usable }) => usable) ? "Take another grid of the file:" : "None of the file's grids will do:"}</p>
      <ul class="grids">
        {grids.map(({ name, type, usable }, i) => (
          <li key={i}>
            {usable ? (
              <button type="button" onClick={() => viewer.assign(grid_key, name)}>
                {name || "(no name)"} <small>{type}</small>
              </button>
            ) : (
              <span>
                {name || "(no name)"} <small>{type}: no density</small>
              </span>
            )}
          </li>
        ))}
      </ul>
    </>
  );
}

/** What went wrong: the last good picture stays below. */
function Alerts() {
  const viewer = useViewer();
  return (
    <div class="alerts">
      <div role="alert">
        {viewer.link === "ended" && (
          <div class="alert lost">
            <p>
              This page belongs to a program that has ended. Open the address that the new <code>brume view</code> printed;
              nothing is tried any more here.
            </p>
          </div>
        )}
        {(viewer.link === "lost" || viewer.link === "stopped") && (
          <div class="alert lost">
            <p>
              {viewer.link === "lost"
                ? "The connection to the program is lost: it is tried again."
                : "The program does not answer: it is no longer tried. A new one prints an address of its own."}
            </p>
            <button type="button" onClick={() => viewer.retry()}>
              Try now
            </button>
          </div>
        )}
        {viewer.problem && (
          <div class="alert problem">
            <div>
              <pre>{viewer.problem.text}</pre>
              <Grids />
            </div>
            <button
              type="button"
              class="icon"
              title="Dismiss"
              aria-label="Dismiss the problem"
              onClick={() => viewer.dismiss()}
            >
              <Icon name="close" />
            </button>
          </div>
        )}
      </div>
      <p class="tool-note" role="status">
        {viewer.tool === "sun" && "Drag on the picture to turn the sun"}
        {viewer.tool === "lamp" && "Click on the picture to put a lamp there"}
      </p>
    </div>
  );
}
