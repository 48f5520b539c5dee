// The panel in which light groups are mixed: nothing is rendered again for it.
import type { Field } from "./protocol";
import { useViewer } from "./context";
import { ColourControl, type Access } from "./field";
import { channels } from "./field_info";
import { ask, gone, stateOf } from "./keep";
import { factorOf, isMixed, mixed, mixKey, mixTaken, withoutMix } from "./mix";
import { Panel } from "./panel";
import type { Viewer } from "./viewer";

const RANGE = { lowest: 0, highest: 4, log: false };
/** As large as the program takes it. */
const FIELD: Field = { key: "mix", type: "color", value: 1, lowest: 0, highest: 1e6 };

export function LightMix() {
  const viewer = useViewer();
  const groups = viewer.scene?.light_groups ?? [];
  if (!groups.length) return null;
  const changed = isMixed(viewer.assignments);
  return (
    <Panel name="mix" title="Lights" kind="mix of groups" open changed={changed}>
      <div class="fields">
        {groups.map((group) => (
          <Group key={group} group={group} />
        ))}
      </div>
      <div class="buttons">
        <button
          type="button"
          hidden={viewer.ofFrames}
          disabled={!changed}
          title="The scene's own lights become as they are mixed; the mix begins anew"
          onClick={() => void intoScene(viewer)}
        >
          Into the scene
        </button>
        <button
          type="button"
          title={
            viewer.ofFrames
              ? "Copy the mix as TOML, for brume mix --mix"
              : "Copy the scene as TOML, with its lights as they are mixed"
          }
          onClick={() => void copyScene(viewer)}
        >
          Copy TOML
        </button>
        <button
          type="button"
          disabled={!changed}
          title="All lights as they are rendered"
          onClick={() => viewer.edit(withoutMix)}
        >
          Reset
        </button>
      </div>
    </Panel>
  );
}

function Group({ group }: { group: string }) {
  const viewer = useViewer();
  const { assignments } = viewer;
  const changed = assignments.has(mixKey(group));
  const reset = () => viewer.reset(mixKey(group));
  const access: Access = {
    label: `light of ${group}`,
    help: "What the group's light is multiplied by; a double click on the slider resets it",
    value: factorOf(assignments, group),
    set: (value, step) => viewer.edit((all) => mixed(all, group, channels(value)), step, false),
    settle: () => viewer.settle(),
    reset,
  };
  return (
    <div class={`field of-color${changed ? " changed" : ""}`} data-key={mixKey(group)}>
      <span class="name" title={group === "rest" ? "Light of everything without a group" : `Light group ${group}`}>
        {group}
      </span>
      <ColourControl field={FIELD} access={access} middle={1} range={RANGE} />
      {changed && (
        <button type="button" class="reset" title="As rendered" aria-label={`Reset light of ${group}`} onClick={reset}>
          ↺
        </button>
      )}
    </div>
  );
}

/** Assigns what makes the scene's lights as they are mixed: one step of undo. */
async function intoScene(viewer: Viewer): Promise<void> {
  const before = viewer.assignments;
  try {
    const response = await ask("mix", stateOf(viewer));
    if (!response.ok) return viewer.say((await response.text()).trim());
    const lights = (await response.json()) as string[];
    if (viewer.assignments !== before) return; // the mix has changed meanwhile
    viewer.edit((all) => mixTaken(all, lights));
    viewer.say("The scene's lights are as they were mixed: Ctrl+Z takes it back");
  } catch {
    viewer.say(gone("mix"));
  }
}

async function copyScene(viewer: Viewer): Promise<void> {
  let text: string;
  try {
    const response = await ask("scene.toml", stateOf(viewer));
    text = await response.text();
    if (!response.ok) return viewer.say(text.trim());
  } catch {
    return viewer.say(gone("scene.toml"));
  }
  try {
    await navigator.clipboard.writeText(text);
    viewer.say(viewer.ofFrames ? "Mix copied as TOML" : "Scene copied as TOML");
  } catch {
    viewer.say("The browser does not let the page copy: save the scene instead");
  }
}
