// Small parts that several views and both pages use.
import type { ComponentChildren } from "preact";

/** One choice of a few, as buttons in a row. */
export function Choice<T extends string | number>(props: {
  label: string;
  /** Printed in front of the buttons. */
  before?: string;
  values: readonly { value: T; text: string; title?: string }[];
  value: T;
  onChange: (value: T) => void;
}) {
  return (
    <div class="choice" role="group" aria-label={props.label}>
      {props.before && <span aria-hidden="true">{props.before}</span>}
      {props.values.map(({ value, text, title }) => (
        <button
          key={value}
          type="button"
          aria-pressed={value === props.value}
          title={title}
          onClick={() => props.onChange(value)}
        >
          {text}
        </button>
      ))}
    </div>
  );
}

export function Select<T extends string>(props: {
  label: string;
  value: T;
  /** Those with the name of a group come last, under it. */
  values: readonly { value: T; text: string; group?: string }[];
  onChange: (value: T) => void;
  class?: string;
}) {
  const groups = [...new Set(props.values.map(({ group }) => group))];
  const options = (of: string | undefined) =>
    props.values
      .filter(({ group }) => group === of)
      .map(({ value, text }) => (
        <option key={value} value={value} selected={value === props.value}>
          {text}
        </option>
      ));
  return (
    <select
      class={props.class}
      aria-label={props.label}
      title={props.label}
      value={props.value}
      onChange={(e) => props.onChange(e.currentTarget.value as T)}
    >
      {options(undefined)}
      {groups.map(
        (group) =>
          group && (
            <optgroup key={group} label={group}>
              {options(group)}
            </optgroup>
          ),
      )}
    </select>
  );
}

export function Section(props: {
  title: string;
  note?: ComponentChildren;
  /** Buttons beside the title. */
  saves?: ComponentChildren;
  children?: ComponentChildren;
}) {
  return (
    <section class="section">
      <header>
        <h2>{props.title}</h2>
        {props.saves}
      </header>
      {props.note && <p class="note">{props.note}</p>}
      {props.children}
    </section>
  );
}

/** Buttons that save what stands below them as files. */
export function Saves(props: { what: string; csv?: () => void; svg?: () => void; png?: () => void }) {
  const kinds = [
    ["CSV", props.csv],
    ["SVG", props.svg],
    ["PNG", props.png],
  ] as const;
  return (
    <div class="saves" role="group" aria-label={`Save: ${props.what}`}>
      {kinds.map(
        ([kind, save]) =>
          save && (
            <button key={kind} type="button" title={`Save as ${kind}: ${props.what}`} onClick={save}>
              {kind}
            </button>
          ),
      )}
    </div>
  );
}

/** A table that scrolls by itself where it is wider than the page. */
export function ScrollTable(props: { label: string; class: string; columns: string[]; children: ComponentChildren }) {
  return (
    <div class="scroll" tabIndex={0} role="region" aria-label={props.label}>
      <table class={props.class}>
        <thead>
          <tr>
            {props.columns.map((column) => (
              <th key={column} scope="col">
                {column}
              </th>
            ))}
          </tr>
        </thead>
        <tbody>{props.children}</tbody>
      </table>
    </div>
  );
}
