// The panels at the side: the picture, and every table of the scene.
import { useId } from "preact/hooks";
import { Choice, Select } from "../controls";
import { stops as stopsText } from "../format";
import { chosenSun, frameBounds, isAdded, resetCamera, suns } from "./actions";
import { lightRemoved, touches } from "./assignments";
import { seenFrom } from "./camera";
import { useViewer } from "./context";
import { Field } from "./field";
import { ordered } from "./field_info";
import { Icon } from "./icons";
import { Keep } from "./keep";
import { LightMix } from "./light_mix";
import { Panel } from "./panel";
import { HistogramPlot } from "./plot";
import type { Group, LayerEntry } from "./protocol";

/** The fields of a table: the most used ones, and the rest when asked for. */
function Fields({ group }: { group: Group }) {
  const viewer = useViewer();
  const title = viewer.values.title(group.path);
  const id = useId();
  const { main, more } = ordered(group.path, group.fields, (key) => viewer.value(`${group.path}.${key}`));
  const name = `${group.path} more`;
  const open = viewer.settings.open[name] ?? false;
  const fields = (list: typeof main) =>
    list.map((field) => <Field key={field.key} path={group.path} title={title} field={field} grids={group.grids} />);
  return (
    <div class="fields">
      {group.optical_depth && (
        <p class="depth" title="Extinction along the middle of the volume's box: above a few it is dense">
          optical depth <b>{group.optical_depth.map((v) => Number(v.toPrecision(3))).join(" × ")}</b>
        </p>
      )}
      {fields(main)}
      {more.length > 0 && (
        <>
          <button
            type="button"
            class="more"
            aria-expanded={open}
            aria-controls={id}
            onClick={() => viewer.set({ open: { ...viewer.settings.open, [name]: !open } })}
          >
            <Icon name="more" /> {more.length} more <span class="hidden-text">of {title}</span>
          </button>
          <div id={id} class="rest" hidden={!open}>
            {open && fields(more)}
          </div>
        </>
      )}
    </div>
  );
}

const KINDS: Record<string, string> = { volumes: "volume", lights: "light", surfaces: "surface" };

function GroupPanel({ group, open }: { group: Group; open: boolean }) {
  const viewer = useViewer();
  const { path } = group;
  const title = viewer.values.title(path);
  const key = `${path}.enabled`;
  const enabled = viewer.value(key);
  const [list, index] = path.split(".");
  const kind = KINDS[list ?? ""];
  return (
    <Panel
      name={path}
      title={kind ? title : capital(title)}
      {...(kind ? { kind } : {})}
      open={open}
      changed={touches(viewer.assignments, path)}
      off={enabled === false}
      side={
        <>
          {list === "lights" && isAdded(viewer, path) && (
            <button
              type="button"
              class="icon quiet"
              title="Take this light away"
              aria-label={`Take ${title} away`}
              onClick={() => viewer.edit((all) => lightRemoved(all, Number(index)))}
            >
              <Icon name="close" />
            </button>
          )}
          {enabled !== undefined && (
            <input
              type="checkbox"
              class="switch"
              role="switch"
              aria-label={`${title} enabled`}
              title={enabled ? "Switch it off" : "Switch it on"}
              checked={enabled === true}
              onChange={(e) => viewer.assign(key, e.currentTarget.checked)}
            />
          )}
        </>
      }
    >
      {list === "camera" && <CameraButtons />}
      <Fields group={group} />
    </Panel>
  );
}

function capital(text: string): string {
  return text.charAt(0).toUpperCase() + text.slice(1);
}

function CameraButtons() {
  const viewer = useViewer();
  return (
    <div class="buttons" role="group" aria-label="Views">
      {(["front", "side", "top"] as const).map((side, i) => (
        <button
          key={side}
          type="button"
          title={`(${i + 1})`}
          onClick={() => viewer.moveCamera((c) => seenFrom(c, side))}
        >
          {capital(side)}
        </button>
      ))}
      <button type="button" title="Show all of the volumes (F)" onClick={() => frameBounds(viewer)}>
        Frame
      </button>
      <button type="button" title="The file's camera (0)" onClick={() => resetCamera(viewer)}>
        Reset
      </button>
    </div>
  );
}

const RESOLUTIONS = [
  { value: 0, text: "Auto", title: "One picture pixel for each of the screen, at most 1280 columns" },
  { value: 0.5, text: "½", title: "Half a picture pixel for each of the screen" },
  { value: 1, text: "1", title: "One picture pixel for each of the screen" },
  { value: 2, text: "2", title: "Two picture pixels for each of the screen" },
];

function PicturePanel() {
  const viewer = useViewer();
  const { settings, scene } = viewer;
  const known: LayerEntry[] = scene?.layers ?? [{ name: "picture", channels: 3 }];
  // One that was chosen before the page was loaded again is listed once it is there.
  const chosen = [settings.layer, settings.other].filter((name) => name && !known.some((l) => l.name === name));
  const layers = [...known, ...chosen.map((name): LayerEntry => ({ name, channels: 0 }))].map(
    ({ name, title, group }) => {
      const unit = viewer.layerUnit(name);
      return { value: name, text: `${title ?? name}${unit && ` [${unit}]`}`, ...(group ? { group } : {}) };
    },
  );
  return (
    <Panel name="picture" title="Picture" open>
      <div class="fields">
        <div class="field">
          <span class="name">layer</span>
          <Select label="Layer" value={settings.layer} values={layers} onChange={(layer) => viewer.set({ layer })} />
        </div>
        <div class="field">
          <span class="name">compare with</span>
          <Select
            label="Compare with layer"
            value={settings.other}
            values={[{ value: "", text: "–" }, ...layers]}
            onChange={(other) => viewer.set({ other })}
          />
        </div>
        <div class="field">
          <span class="name" title="Display: beside the scene's own exposure [ ]">
            exposure
          </span>
          <input
            type="range"
            min={-8}
            max={8}
            step={0.05}
            value={settings.stops}
            aria-label="Exposure in stops"
            aria-valuetext={stopsText(settings.stops)}
            onInput={(e) => viewer.set({ stops: Number(e.currentTarget.value) })}
          />
          <output>{stopsText(settings.stops)}</output>
          {settings.stops !== 0 && (
            <button
              type="button"
              class="reset"
              title="The scene's exposure (\)"
              aria-label="Reset exposure"
              onClick={() => viewer.set({ stops: 0 })}
            >
              ↺
            </button>
          )}
        </div>
        <div class="field">
          <span class="name">tone curve</span>
          <Select
            label="Tone curve"
            value={viewer.tone}
            values={viewer.tones}
            onChange={(tone) => viewer.set({ tone })}
          />
        </div>
        <div class="field">
          <span class="name" title="Picture pixels for each pixel of the screen">
            resolution
          </span>
          <Choice
            label="Resolution"
            values={RESOLUTIONS}
            value={settings.resolution}
            onChange={(resolution) => viewer.set({ resolution })}
          />
        </div>
        <HistogramPlot />
      </div>
    </Panel>
  );
}

/** Which sun the sun tool turns, where there are several. */
function SunChoice() {
  const viewer = useViewer();
  const all = suns(viewer);
  if (viewer.tool !== "sun" || all.length < 2) return null;
  return (
    <div class="field chosen-sun">
      <span class="name">sun to turn</span>
      <Select
        label="Sun to turn"
        value={chosenSun(viewer)?.key ?? ""}
        values={all.map(({ key, title }) => ({
          value: key,
          text: `${title} (${key.split(".").slice(0, -1).join(" ")})`,
        }))}
        onChange={(key) => {
          viewer.sun = key;
          viewer.use("sun");
        }}
      />
    </div>
  );
}

/** Tables in the order in which they are used. */
const ORDER = ["camera", "volumes", "lights", "environment", "surfaces"];
const KNOWN = new Set(ORDER);

export function Panels() {
  const viewer = useViewer();
  const { scene } = viewer;
  const others = (scene?.groups ?? []).filter(({ path }) => !KNOWN.has(path.split(".")[0]!));
  const notes = [...(scene?.notes ?? [])];
  return (
    <aside class="panels" aria-label="Scene and picture">
      <SunChoice />
      <PicturePanel />
      <LightMix />
      {ORDER.flatMap((kind) =>
        viewer.values
          .groups(kind)
          .map((group, i) => (
            <GroupPanel key={group.path} group={group} open={kind !== "camera" && kind !== "surfaces" && i < 2} />
          )),
      )}
      {others.map((group) => (
        <GroupPanel key={group.path} group={group} open={false} />
      ))}
      <Panel name="keep" title="Keep" open>
        <Keep />
      </Panel>
      {(notes.length > 0 || (scene?.left_out?.length ?? 0) > 0) && (
        <Panel name="notes" title="Notes" open>
          <ul class="notes">
            {notes.map((note) => (
              <li key={note}>{note}</li>
            ))}
            {scene?.left_out?.map((what) => (
              <li key={what}>The predicted picture leaves out: {what}</li>
            ))}
          </ul>
        </Panel>
      )}
    </aside>
  );
}
