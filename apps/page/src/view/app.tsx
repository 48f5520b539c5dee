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
  const { scene, settings, history, tool } = viewer;

  useEffect(() => {
    const key = (event: KeyboardEvent) => handleKey(event, viewer, { help: openHelp });
    addEventListener("keydown", key);
    return () => removeEventListener("keydown", key);
  }, []);
  useEffect(() => {
    document.title = scene ? `${scene.name} – brume` : "brume";
  }, [scene?.name]);

  return (
    <div class={`viewer${settings.panels ? "" : " wide"}`}>
      <header class="top">
        <h1>
          <svg viewBox="0 0 32 32" aria-hidden="true">
            <path d="M4 11c5-5 9 3 14 0s6-4 10-2M3 18c6-5 10 3 15 0s7-4 11-2M7 25c5-4 8 2 12 0s5-3 8-2" />
          </svg>
          <span class="name">{scene?.name ?? "brume"}</span>
        </h1>
        <div class="tools" role="group" aria-label="Tools">
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
            title="The scene as its file has it"
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

/** What went wrong: the last good picture stays below. */
function Alerts() {
  const viewer = useViewer();
  return (
    <div class="alerts">
      <div role="alert">
        {viewer.link === "lost" && (
          <div class="alert lost">
            <p>The connection to the program is lost: it is tried again.</p>
            <button type="button" onClick={() => viewer.retry()}>
              Try now
            </button>
          </div>
        )}
        {viewer.problem && (
          <div class="alert problem">
            <pre>{viewer.problem.text}</pre>
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
