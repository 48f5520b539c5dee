// What to take along: the scene, the picture, the command line.
import { useViewer } from "./context";
import { Icon } from "./icons";
import { paint } from "./stage";
import type { Viewer } from "./viewer";

function save(name: string, content: Blob): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(content);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}

/** Saves what the program has at a relative address, or says why there is nothing. */
async function saveFrom(viewer: Viewer, address: string, name: string): Promise<void> {
  try {
    const response = await fetch(address, { cache: "no-store" });
    if (response.ok) save(name, await response.blob());
    else viewer.say((await response.text()).trim() || `There is no ${address} yet`);
  } catch {
    viewer.say(`${address} could not be read: is the program still there?`);
  }
}

/** The picture as it is seen, at its own resolution. */
function savePicture(viewer: Viewer, name: string): void {
  const picture = viewer.shown(viewer.settings.layer)?.picture;
  if (!picture) return viewer.say("There is no picture yet");
  const canvas = document.createElement("canvas");
  canvas.width = picture.width;
  canvas.height = picture.height;
  paint(canvas.getContext("2d")!, { left: 0, top: 0, width: picture.width, height: picture.height }, viewer);
  canvas.toBlob((blob) => blob && save(name, blob), "image/png");
}

async function copy(viewer: Viewer, text: string): Promise<void> {
  try {
    await navigator.clipboard.writeText(text);
    viewer.say("Command line copied");
  } catch {
    viewer.say("The browser does not let the page copy: select the text instead");
  }
}

export function Keep() {
  const viewer = useViewer();
  const { scene } = viewer;
  const frame = viewer.frame === null ? "" : `.${String(viewer.frame).padStart(4, "0")}`;
  const name = `${scene?.name || "volume"}${frame}`;
  return (
    <div class="keep">
      <div class="buttons">
        <button type="button" onClick={() => void saveFrom(viewer, "scene.toml", `${scene?.name || "volume"}.toml`)}>
          <Icon name="save" /> Scene
        </button>
        <button type="button" onClick={() => savePicture(viewer, `${name}.png`)}>
          <Icon name="save" /> PNG
        </button>
        <button
          type="button"
          title="The last path-traced frame with all its layers"
          onClick={() => void saveFrom(viewer, "frame.exr", `${name}.exr`)}
        >
          <Icon name="save" /> EXR
        </button>
      </div>
      {scene?.command && (
        <div class="command">
          <code tabIndex={0} role="region" aria-label="Command line">
            {scene.command}
          </code>
          <button
            type="button"
            class="icon"
            title="Copy the command line"
            aria-label="Copy the command line"
            onClick={() => void copy(viewer, scene.command!)}
          >
            <Icon name="copy" />
          </button>
        </div>
      )}
    </div>
  );
}
