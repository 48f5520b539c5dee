// One field of the scene, by its type.
import { useEffect, useRef } from "preact/hooks";
import { Select } from "../controls";
import type { Value } from "./assignments";
import { useViewer } from "./context";
import {
  channels,
  colourOf,
  hexOf,
  labelOf,
  shortColour,
  sliderPlace,
  sliderRange,
  sliderValue,
  SLIDER_STEP,
  SLIDER_STEPS,
  strengthOf,
  unitText,
  type SliderRange,
} from "./field_info";
import { NumberInput, shortNumber } from "./number_input";
import type { Field as FieldEntry } from "./protocol";

interface Props {
  path: string;
  /** Of the table, for names that screen readers tell apart. */
  title: string;
  field: FieldEntry;
  /** Of a volume's file: choices for the names of grids. */
  grids?: readonly string[] | undefined;
}

/** How a field's parts get and set its value. */
export interface Access {
  label: string;
  help: string | undefined;
  value: Value | undefined;
  /** @param step  while a slider is dragged */
  set: (value: Value, step?: string) => void;
  settle: () => void;
  /** What a double click on the slider does. */
  reset?: () => void;
}

export function Field({ path, title, field: entry, grids }: Props) {
  const viewer = useViewer();
  const key = `${path}.${entry.key}`;
  const value = viewer.value(key);
  const choices = grids?.length && entry.key.endsWith("grid") ? gridChoices(entry.key, String(value ?? ""), grids) : [];
  const field: FieldEntry = choices.length && entry.type === "text" ? { ...entry, type: "choice", choices } : entry;
  const changed = viewer.assignments.has(key);
  const unit = unitText(field.unit);
  const help = [`${key}:`, field.help, unit && `[${unit}]`].filter(Boolean).join(" ");
  const access: Access = {
    label: `${title} ${labelOf(field.key)}`,
    help,
    value,
    set: (v, step) => viewer.assign(key, v, step),
    settle: () => viewer.settle(),
  };
  return (
    <div class={`field of-${field.type}${changed ? " changed" : ""}`} data-key={key}>
      <span class="name" title={help}>
        {labelOf(field.key)}
        {unit && <small> {unit}</small>}
      </span>
      {field.fixed ? (
        <span class="fixed">{textOf(value) || "–"}</span>
      ) : (
        <Control field={field} access={access} unchanged={viewer.values.unchanged(key)} />
      )}
      {changed && (
        <button
          type="button"
          class="reset"
          title="As the file has it"
          aria-label={`Reset ${title} ${labelOf(field.key)}`}
          onClick={() => viewer.reset(key)}
        >
          ↺
        </button>
      )}
    </div>
  );
}

/** What a field that names a grid may be. */
function gridChoices(key: string, value: string, grids: readonly string[]): string[] {
  return [...new Set([value, ...(key === "grid" ? [""] : ["none", "auto"]), ...grids])];
}

function Control({ field, access, unchanged }: { field: FieldEntry; access: Access; unchanged: Value | undefined }) {
  const { label, help, value, set } = access;
  switch (field.type) {
    case "switch":
      return (
        <input
          type="checkbox"
          class="switch"
          role="switch"
          aria-label={label}
          title={help}
          checked={value === true}
          onChange={(e) => set(e.currentTarget.checked)}
        />
      );
    case "choice":
      return (
        <Select
          label={label}
          value={String(value)}
          values={(field.choices ?? [String(value)]).map((choice) => ({ value: choice, text: choice || "auto" }))}
          onChange={set}
        />
      );
    case "number":
    case "integer":
      return <NumberControl field={field} access={access} middle={Number(unchanged ?? value)} />;
    case "color":
      return <ColourControl field={field} access={access} middle={strengthOf(channels(unchanged ?? value))} />;
    case "vector":
      return <VectorControl field={field} access={access} />;
    case "numbers":
      return <TextControl access={access} read={readNumbers} />;
    case "text":
      return <TextControl access={access} read={(text) => text} />;
  }
}

function Slider(props: {
  access: Access;
  range: SliderRange;
  value: number;
  onSlide: (v: number, step?: string) => void;
}) {
  const { access, range, value, onSlide } = props;
  const input = useRef<HTMLInputElement>(null);
  /** Of a drag: the pointer's last place, and the slider's in fractions of a step. */
  const drag = useRef<{ x: number; place: number } | undefined>(undefined);
  const put = (place: number, on = range) =>
    onSlide(sliderValue(on, Math.min(SLIDER_STEPS, Math.max(0, Math.round(place)))), access.label);
  const stepOf = (event: { shiftKey: boolean }) => (event.shiftKey ? SLIDER_STEP.fine : SLIDER_STEP.coarse);
  const latest = useRef({ put, range, value });
  latest.current = { put, range, value };

  // The wheel turns a slider that has been clicked; elsewhere it scrolls the panels.
  useEffect(() => {
    const element = input.current!;
    let rest: ReturnType<typeof setTimeout> | undefined;
    const wheel = (event: WheelEvent) => {
      if (document.activeElement !== element) return;
      event.preventDefault();
      // With Shift some systems turn the wheel sideways.
      const turned = event.deltaY || event.deltaX;
      const { put, range, value } = latest.current;
      put(sliderPlace(range, value) - Math.sign(turned) * stepOf(event));
      clearTimeout(rest);
      rest = setTimeout(access.settle, 300);
    };
    element.addEventListener("wheel", wheel, { passive: false });
    return () => element.removeEventListener("wheel", wheel);
  }, []);

  return (
    <input
      ref={input}
      type="range"
      min={0}
      max={SLIDER_STEPS}
      step={1}
      value={sliderPlace(range, value)}
      aria-label={`${access.label}, slider`}
      aria-valuetext={shortNumber(value)}
      title={`${access.help ?? ""}\nShift: ten times finer; arrow keys and wheel step a slider that was clicked`}
      onInput={(e) => onSlide(sliderValue(range, Number(e.currentTarget.value)), access.label)}
      onChange={access.settle}
      onDblClick={access.reset}
      onKeyDown={(e) => {
        const by = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1 }[e.key];
        if (by === undefined) return;
        e.preventDefault();
        put(sliderPlace(range, value) + by * stepOf(e));
      }}
      onKeyUp={(e) => e.key.startsWith("Arrow") && access.settle()}
      // A mouse drags by its way instead of its place: with Shift a tenth of it.
      onMouseDown={(e) => {
        if (e.button !== 0) return;
        e.preventDefault();
        const element = e.currentTarget;
        element.focus({ preventScroll: true });
        const { left, width } = element.getBoundingClientRect();
        const at = e.shiftKey ? sliderPlace(range, value) : ((e.clientX - left - 8) / (width - 16)) * SLIDER_STEPS;
        drag.current = { x: e.clientX, place: at };
        if (!e.shiftKey) put(at);
        const move = (event: MouseEvent) => {
          const now = drag.current!;
          const way = ((event.clientX - now.x) / (width - 16)) * SLIDER_STEPS;
          drag.current = { x: event.clientX, place: now.place + way * (event.shiftKey ? 0.1 : 1) };
          // The range of a drag is the one that it began with.
          latest.current.put(drag.current.place, range);
        };
        const end = () => {
          removeEventListener("mousemove", move);
          removeEventListener("mouseup", end);
          access.settle();
        };
        addEventListener("mousemove", move);
        addEventListener("mouseup", end);
      }}
    />
  );
}

/** A step of an arrow key: about a hundredth of the value, a round number. */
function stepOf(value: number): number {
  return Math.abs(value) > 0 ? 10 ** (Math.floor(Math.log10(Math.abs(value))) - 1) : 0.01;
}

function NumberControl({ field, access, middle }: { field: FieldEntry; access: Access; middle: number }) {
  const value = Number(access.value ?? 0);
  const range = sliderRange(field, middle, value);
  return (
    <>
      {range && <Slider access={access} range={range} value={value} onSlide={access.set} />}
      <NumberInput
        label={access.label}
        help={access.help}
        value={value}
        lowest={field.lowest}
        highest={field.highest}
        integer={field.type === "integer"}
        step={range && !range.log ? (range.highest - range.lowest) / 100 : stepOf(value)}
        onChange={access.set}
      />
    </>
  );
}

/** Strength times colour: the strength is the largest channel. */
export function ColourControl(props: {
  field: FieldEntry;
  access: Access;
  middle: number;
  /** Of the slider; nothing: as suits the field. */
  range?: SliderRange;
}) {
  const { field, access, middle } = props;
  const rgb = channels(access.value);
  const strength = strengthOf(rgb);
  // Of a black one, so that a slider that touches zero does not lose it.
  const lastColour = useRef<readonly number[]>([1, 1, 1]);
  if (strength > 0) lastColour.current = rgb.map((v) => v / strength);
  const range = props.range ?? sliderRange(field, middle, strength);
  const strengthen = (to: number, step?: string) =>
    access.set(
      shortColour((strength > 0 ? rgb.map((v) => v / strength) : lastColour.current).map((v) => v * to)),
      step,
    );
  const highest = field.highest ?? Infinity;
  return (
    <>
      {range && <Slider access={access} range={range} value={strength} onSlide={strengthen} />}
      <input
        type="color"
        value={hexOf(strength > 0 ? rgb : lastColour.current)}
        aria-label={`${access.label}, colour`}
        title={access.help}
        onInput={(e) =>
          access.set(
            shortColour(colourOf(e.currentTarget.value).map((v) => v * (strength || Math.min(1, highest)))),
            `${access.label} colour`,
          )
        }
        onChange={access.settle}
      />
      <NumberInput
        label={access.label}
        help={access.help}
        value={strength}
        lowest={field.lowest}
        highest={field.highest}
        step={range && !range.log ? (range.highest - range.lowest) / 100 : stepOf(strength)}
        onChange={strengthen}
      />
    </>
  );
}

function VectorControl({ field, access }: { field: FieldEntry; access: Access }) {
  const vector = channels(access.value);
  const size = Math.max(...vector.map(Math.abs));
  return (
    <span class="vector">
      {(["x", "y", "z"] as const).map((axis, i) => (
        <NumberInput
          key={axis}
          label={`${access.label} ${axis}`}
          help={access.help}
          value={vector[i]!}
          lowest={field.lowest}
          highest={field.highest}
          digits={4}
          step={stepOf(size)}
          onChange={(v) => access.set(vector.map((old, k) => (k === i ? v : old)))}
        />
      ))}
    </span>
  );
}

/** A list of numbers as JSON writes it, which TOML reads too; nothing where it is none. */
function readNumbers(text: string): Value | undefined {
  try {
    const list: unknown = JSON.parse(text.trim().startsWith("[") ? text : `[${text}]`);
    const fine = (v: unknown): boolean => typeof v === "number" || (Array.isArray(v) && v.every(fine));
    return fine(list) ? (list as Value) : undefined;
  } catch {
    return undefined;
  }
}

function textOf(value: Value | undefined): string {
  if (value === undefined) return "";
  return typeof value === "string" ? value : JSON.stringify(value).replace(/,/g, ", ");
}

function TextControl({ access, read }: { access: Access; read: (text: string) => Value | undefined }) {
  return (
    <input
      type="text"
      aria-label={access.label}
      title={access.help}
      autocomplete="off"
      spellcheck={false}
      value={textOf(access.value)}
      onChange={(e) => {
        const value = read(e.currentTarget.value);
        if (value === undefined) e.currentTarget.value = textOf(access.value);
        else access.set(value);
      }}
    />
  );
}
