// What to take along: the scene, the picture, the command line, each as it is seen at the moment of the click.
import { useEffect, useState } from "preact/hooks";
import { useViewer } from "./context";
import { Icon } from "./icons";
import { paint } from "./stage";
import type { Viewer } from "./viewer";

/** Between two questions whether a frame is there [ms]. */
const ASK_AGAIN = 400;

function save(name: string, content: Blob): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(content);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}

export const stateOf = (viewer: Viewer) => ({ ...viewer.state, moving: false });

/** What the program answers to a state of the page. @param address  relative */
export function ask(address: string, state: object): Promise<Response> {
  const body = JSON.stringify({ type: "look", id: 0, ...state });
  return fetch(address, { method: "POST", body, cache: "no-store" });
}

export const gone = (address: string) => `${address} could not be read: is the program still there?`;

/** Saves what the program makes of the present state, or says why there is nothing. */
async function saveScene(viewer: Viewer, name: string): Promise<void> {
  try {
    const response = await ask("scene.toml", stateOf(viewer));
    if (response.ok) save(name, await response.blob());
    else viewer.say((await response.text()).trim());
  } catch {
    viewer.say(gone("scene.toml"));
  }
}

/** Saves the frame of the present state: at once, or when the whole picture of it is there. */
async function saveFrame(viewer: Viewer, name: string): Promise<void> {
  const state = stateOf(viewer);
  // Which layers are shown matters to no frame.
  const same = () => JSON.stringify({ ...stateOf(viewer), layers: [] }) === JSON.stringify({ ...state, layers: [] });
  try {
    for (let waited = false; ; waited = true) {
      const response = await ask("frame.exr", state);
      if (response.status === 200) {
        save(name, await response.blob());
        const stage = response.headers.get("X-Picture") ?? "";
        return viewer.say(`EXR saved${stage && `: ${stage}`}`);
      }
      if (response.status !== 202) return viewer.say((await response.text()).trim());
      if (!same()) return viewer.say("Another view was chosen before the EXR's picture was there: nothing was saved");
      if (!waited || !viewer.said) viewer.say("The EXR is saved as soon as the whole picture is there");
      await new Promise((resolve) => setTimeout(resolve, ASK_AGAIN));
      if (!same()) return viewer.say("Another view was chosen before the EXR's picture was there: nothing was saved");
    }
  } catch {
    viewer.say(gone("frame.exr"));
  }
}

/** The picture as it is seen, at the size that is asked for: one that is still coarse is drawn larger, as on the screen. */
function savePicture(viewer: Viewer, name: string): void {
  const [missing] = viewer.missing;
  if (missing !== undefined)
    return viewer.say(
      missing === "picture" ? "There is no picture yet" : `There is no layer “${viewer.layerTitle(missing)}” yet`,
    );
  const pictures = viewer.layers.map((layer) => viewer.shown(layer)!.picture);
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = viewer.ofFrames ? [pictures[0]!.width, pictures[0]!.height] : viewer.size;
  paint(canvas.getContext("2d")!, { left: 0, top: 0, width: canvas.width, height: canvas.height }, viewer);
  canvas.toBlob((blob) => blob && save(name, blob), "image/png");
  const coarse = pictures.find(({ width, full }) => width < canvas.width || !full);
  viewer.say(
    coarse
      ? `PNG saved as seen, ${canvas.width} × ${canvas.height}: the picture was still coarse`
      : `PNG saved, ${canvas.width} × ${canvas.height}`,
  );
}

async function copyCommand(viewer: Viewer): Promise<void> {
  try {
    const response = await ask("command", stateOf(viewer));
    if (!response.ok) return viewer.say((await response.text()).trim());
    await navigator.clipboard.writeText((await response.text()).trim());
    viewer.say("Command line copied");
  } catch {
    viewer.say("The browser does not let the page copy: select the text instead");
  }
}

/** The name of what is kept, with the frame's number where the scene's name has a place for it. */
export function keptName(scene: string, frame: number | null): string {
  const name = scene || "volume";
  if (frame === null) return name;
  const digits = String(frame);
  const place = /#+/.exec(name);
  return place
    ? name.replace(place[0], digits.padStart(place[0].length, "0"))
    : `${name}.${digits.padStart(4, "0")}`;
}

/** After the last change of a mix of lights, until its command line is asked for [ms]. */
const MIX_RESTS = 300;

/** The command line of the scene, with lights as they are mixed. */
function useCommand(viewer: Viewer): string | undefined {
  const told = viewer.scene?.command;
  const mix = JSON.stringify(viewer.state.mix);
  const [mixed, setMixed] = useState({ of: "", text: "" });
  const of = `${told} ${mix}`;
  useEffect(() => {
    if (!mix) return;
    const read = async () => {
      const response = await ask("command", stateOf(viewer)).catch(() => undefined);
      if (response?.ok) setMixed({ of, text: (await response.text()).trim() });
    };
    const timer = setTimeout(() => void read(), MIX_RESTS);
    return () => clearTimeout(timer);
  }, [of]);
  return mix && mixed.of === of ? mixed.text : told;
}

export function Keep() {
  const viewer = useViewer();
  const { scene } = viewer;
  const command = useCommand(viewer);
  const name = keptName(scene?.name ?? "", scene?.frames ? viewer.shownFrame : null);
  return (
    <div class="keep">
      <div class="buttons">
        {viewer.ofFrames ? (
          <button
            type="button"
            hidden={!scene?.light_groups?.length}
            title="The mix of lights as TOML, for brume mix --mix"
            onClick={() => void saveScene(viewer, `${keptName(scene?.name ?? "", null)}_mix.toml`)}
          >
            <Icon name="save" /> Mix
          </button>
        ) : (
          <button
            type="button"
            title="The scene as it is seen now"
            onClick={() => void saveScene(viewer, `${keptName(scene?.name ?? "", null)}.toml`)}
          >
            <Icon name="save" /> Scene
          </button>
        )}
        <button type="button" title="The picture as it is seen now" onClick={() => savePicture(viewer, `${name}.png`)}>
          <Icon name="save" /> PNG
        </button>
        <button
          type="button"
          title={
            viewer.ofFrames
              ? "The frame, with its lights as they are mixed"
              : "The frame of what is seen now, with all its layers: path traced where samples are there, else predicted"
          }
          onClick={() => void saveFrame(viewer, `${name}.exr`)}
        >
          <Icon name="save" /> EXR
        </button>
      </div>
      {command && (
        <div class="command">
          <code tabIndex={0} role="region" aria-label="Command line">
            {command}
          </code>
          <button
            type="button"
            class="icon"
            title="Copy the command line of what is seen now"
            aria-label="Copy the command line"
            onClick={() => void copyCommand(viewer)}
          >
            <Icon name="copy" />
          </button>
        </div>
      )}
    </div>
  );
}
