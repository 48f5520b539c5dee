// The pictures: swipe, flip and grid.
import { useState } from "preact/hooks";
import { cssGradient, luminance, TONE_NAMES, TONES } from "./color";
import { usePage } from "./context";
import { Choice, Select } from "./controls";
import { Divider } from "./divider";
import { number, signed, stops as stopsText } from "./format";
import { drawTiles, savePng, type Tile } from "./figure";
import { DIFFERENCES, ERROR_KINDS, errorColours, ERRORS, type Look as Colours } from "./library";
import { Pane, type Pixel } from "./pane";
import { REFERENCE } from "./results";
import { listedMethods, shownMethods, type Mode, type Show } from "./state";
import { WHOLE, type Size, type Viewport } from "./viewport";

interface Props {
  onPane: (pane: Size, picture: Size) => void;
  zoom: (factor: number) => boolean;
  actualSize: () => boolean;
}

const MODE_NAMES: { value: Mode; text: string; title: string }[] = [
  { value: "swipe", text: "Swipe", title: "A left of a divider, B right of it (1)" },
  { value: "flip", text: "Flip", title: "One picture at a time, Space for the other (2)" },
  { value: "grid", text: "Grid", title: "All of them side by side (3)" },
];

export function fullScale(kind: keyof typeof ERRORS, gain: number): number {
  return ERRORS[kind].full * 2 ** gain;
}

export function Look({ onPane, zoom, actualSize }: Props) {
  const { index, library, view, set, name } = usePage();
  const [probe, setProbe] = useState<Pixel | undefined>();
  const scene = index.results.scenes.find((s) => s.name === view.scene);
  const size = library.size(view.scene);
  if (!size) return <p class="empty">This page holds no pictures of {view.scene}.</p>;

  const sceneExposure = scene?.exposure ?? 1;
  const errors = view.show === "error";
  const difference = view.show === "difference";
  const full = fullScale(view.error, view.gain);
  const coloursOf = (id: string): Colours =>
    errors && id !== REFERENCE
      ? { show: "error", kind: view.error, full, exposure: sceneExposure, base: REFERENCE }
      : { show: "picture", tone: view.tone, exposure: sceneExposure * 2 ** view.stops };
  /** A minus another picture. */
  const differenceTo = (id: string) =>
    library.canvas(view.scene, view.spp, view.a, {
      show: "error",
      kind: view.error,
      full,
      exposure: sceneExposure,
      base: id,
    });
  const canvasOf = (id: string) =>
    difference ? differenceTo(id) : library.canvas(view.scene, view.spp, id, coloursOf(id));
  const value = (id: string) => index.estimate(view.scene, view.spp, id, view.region, view.metric)?.mean;
  const metricName = index.metrics.get(view.metric)?.name ?? "";
  const describe = (id: string) =>
    difference
      ? `${DIFFERENCES[view.error]}: ${name(view.a)} − ${name(id)}, ${view.spp} spp`
      : `${name(id)}${id === REFERENCE ? "" : `, ${view.spp} spp`}${errors && id !== REFERENCE ? `, ${ERRORS[view.error].name}` : ""}`;
  const pane = {
    picture: size,
    view,
    onView: (step: (view: Viewport) => Viewport) =>
      set((now) => {
        const { x, y, zoom } = step(now);
        return { x, y, zoom };
      }),
    onProbe: setProbe,
    onSize: (s: Size) => onPane(s, size),
  };
  /** In the grid, the error at the pixel under the pointer. */
  const here = (id: string) => {
    if (view.mode !== "grid" || !probe) return undefined;
    const [of, base] = difference ? [view.a, id] : [id, REFERENCE];
    const map = library.difference(view.error, view.scene, view.spp, of, base, sceneExposure);
    if (!map) return undefined;
    const error = map[probe.y * size.width + probe.x]!;
    return `${ERRORS[view.error].short} here ${ERRORS[view.error].signed ? signed(error) : number(error)}`;
  };
  const caption = (id: string) => (
    <>
      <span class="name">{difference && view.mode === "grid" ? `A − ${name(id)}` : name(id)}</span>
      {index.row(view.scene, view.spp, id, view.region)?.failed && <span class="failed">failed</span>}
      {id !== REFERENCE && value(id) !== undefined && (
        <span class="value">{here(id) ?? `${metricName} ${number(value(id))}`}</span>
      )}
    </>
  );
  const tiles = [REFERENCE, ...shownMethods(index, view)].filter((id) => library.has(view.scene, view.spp, id));
  /** What is seen, pixel for pixel, with names and values under it. */
  const save = () => {
    const value = (id: string) => {
      const e = index.estimate(view.scene, view.spp, id, view.region, view.metric);
      return id !== REFERENCE && e ? `${metricName} ${number(e.mean)}` : "";
    };
    const seen = view.mode === "grid" ? tiles : difference ? [view.b] : [view.a, view.b];
    const figure = seen.flatMap((id): Tile[] => {
      const canvas = canvasOf(id);
      return canvas
        ? [{ canvas, caption: difference ? `${name(view.a)} − ${name(id)}` : name(id), value: value(id) }]
        : [];
    });
    const what = difference ? `_${DIFFERENCES[view.error]}` : errors ? `_${ERRORS[view.error].name}` : "";
    void savePng(`${view.scene}_${view.spp}spp${what}`, drawTiles(figure));
  };

  return (
    <div class="look">
      <div class="toolbar">
        <Choice label="How to compare" values={MODE_NAMES} value={view.mode} onChange={(mode) => set({ mode })} />
        {view.mode !== "grid" && (
          <div class="pickers">
            <PicturePicker which="a" />
            <button
              type="button"
              class="icon"
              title="Exchange A and B (x)"
              aria-label="Exchange A and B"
              onClick={() => set(({ a, b }) => ({ a: b, b: a }))}
            >
              ⇄
            </button>
            <PicturePicker which="b" />
          </div>
        )}
        <div class="zooms" role="group" aria-label="Zoom">
          <button
            type="button"
            class="icon"
            title="Further (−)"
            aria-label="Zoom out"
            onClick={() => zoom(Math.SQRT1_2)}
          >
            −
          </button>
          <button type="button" title="The whole picture (0)" onClick={() => set({ ...WHOLE })}>
            Fit
          </button>
          <button type="button" title="One picture pixel for one of the screen (o)" onClick={actualSize}>
            1:1
          </button>
          <button type="button" class="icon" title="Closer (+)" aria-label="Zoom in" onClick={() => zoom(Math.SQRT2)}>
            +
          </button>
          <button type="button" title="Save the whole pictures that are seen, with names and values" onClick={save}>
            PNG
          </button>
        </div>
      </div>

      {view.mode === "grid" ? (
        <div class="grid">
          {tiles.map((id) => (
            <figure
              key={id}
              class={`tile${id === view.a ? " is-a" : ""}${id === view.b ? " is-b" : ""}`}
              style={{ "--aspect": `${size.width} / ${size.height}` }}
            >
              <Pane {...pane} left={canvasOf(id)} label={describe(id)} mark={probe} />
              <figcaption>{caption(id)}</figcaption>
            </figure>
          ))}
        </div>
      ) : (
        <div class="stage" style={{ "--aspect": `${size.width} / ${size.height}` }}>
          {difference ? (
            <Pane {...pane} left={canvasOf(view.b)} label={describe(view.b)} />
          ) : view.mode === "swipe" ? (
            <Pane
              {...pane}
              left={canvasOf(view.a)}
              right={canvasOf(view.b)}
              split={view.split}
              label={`Left ${describe(view.a)}; right ${describe(view.b)}`}
              onSplit={(split) => set({ split })}
            />
          ) : (
            <Pane
              {...pane}
              left={canvasOf(view[view.front])}
              label={describe(view[view.front])}
              onTap={() => set(({ front }) => ({ front: front === "a" ? "b" : "a" }))}
            />
          )}
          {(difference || view.mode === "swipe" || view.front === "a") && (
            <div class="corner a">
              <span class="badge a">A</span> {caption(view.a)}
              {difference && <span aria-label="minus">−</span>}
            </div>
          )}
          {(difference || view.mode === "swipe" || view.front === "b") && (
            <div class="corner b">
              <span class="badge b">B</span> {caption(view.b)}
            </div>
          )}
          {view.mode === "swipe" && !difference && (
            <Divider
              label="Divider between A and B"
              split={view.split}
              onStep={(by) => set(({ split }) => ({ split: split + by }))}
            />
          )}
        </div>
      )}

      <div class="toolbar below">
        <Choice
          label="What to show"
          values={[
            { value: "picture", text: "Picture", title: "(e)" },
            { value: "error", text: "Error", title: "Error map against the reference (e)" },
            { value: "difference", text: "A − B", title: "A minus B; in the grid A minus each (g)" },
          ]}
          value={view.show}
          onChange={(show: Show) => set(showing(show))}
        />
        {errors || difference ? (
          <>
            <Select
              label="Kind of error"
              value={view.error}
              values={ERROR_KINDS.map((kind) => ({
                value: kind,
                text: difference ? DIFFERENCES[kind] : ERRORS[kind].name,
              }))}
              onChange={(error) => set({ error, gain: 0 })}
            />
            <Legend />
          </>
        ) : (
          <>
            <Select
              label="Tone curve"
              value={view.tone}
              values={TONES.map((tone) => ({ value: tone, text: TONE_NAMES[tone] }))}
              onChange={(tone) => set({ tone })}
            />
            <label class="slider">
              <span>Exposure</span>
              <input
                type="range"
                min={-6}
                max={6}
                step={0.25}
                value={view.stops}
                aria-valuetext={stopsText(view.stops)}
                onInput={(e) => set({ stops: Number(e.currentTarget.value) })}
              />
              <output>{stopsText(view.stops)}</output>
            </label>
            {view.stops !== 0 && (
              <button type="button" title="The scene's exposure (\)" onClick={() => set({ stops: 0 })}>
                Reset
              </button>
            )}
          </>
        )}
      </div>

      <Probe pixel={probe} exposure={sceneExposure} />
    </div>
  );
}

/** The step to pictures, errors or A minus B: that is at first a signed difference. */
export function showing(show: Show) {
  return show === "difference" ? ({ show, error: "luminance", gain: 0 } as const) : { show };
}

/** Which picture is A or B. */
function PicturePicker({ which }: { which: "a" | "b" }) {
  const { index, library, view, set, name } = usePage();
  const ids = [REFERENCE, ...listedMethods(index, view)].filter((id) => library.has(view.scene, view.spp, id));
  if (!ids.includes(view[which])) ids.push(view[which]);
  return (
    <label class={`picker ${which}`}>
      <span class={`badge ${which}`}>{which.toUpperCase()}</span>
      <Select
        label={`Picture ${which.toUpperCase()}`}
        value={view[which]}
        values={ids.map((id) => ({ value: id, text: name(id) }))}
        onChange={(id) => set({ [which]: id })}
      />
    </label>
  );
}

/** A round number without trailing zeros. */
function plain(value: number): string {
  return String(Number(value.toPrecision(4)));
}

function Legend() {
  const { view, set } = usePage();
  const { unit, signed: both } = ERRORS[view.error];
  const full = fullScale(view.error, view.gain);
  return (
    <div class="legend">
      <button
        type="button"
        class="icon"
        aria-label="÷2: halve the scale"
        title="Halve the scale (<)"
        disabled={view.gain <= -8}
        onClick={() => set(({ gain }) => ({ gain: gain - 1 }))}
      >
        ÷2
      </button>
      <div class="ramp">
        <div class="bar" style={{ background: cssGradient(errorColours(view.error)) }} />
        <div class="ticks">
          <span>{both ? `−${plain(full)}` : "0"}</span>
          <span>{both ? "0" : plain(full / 2)}</span>
          <span>
            {plain(full)} {unit}
          </span>
        </div>
      </div>
      <button
        type="button"
        class="icon"
        aria-label="×2: double the scale"
        title="Double the scale (>)"
        disabled={view.gain >= 8}
        onClick={() => set(({ gain }) => ({ gain: gain + 1 }))}
      >
        ×2
      </button>
    </div>
  );
}

/** Values of A, B and the reference at the pixel under the pointer. */
function Probe({ pixel, exposure }: { pixel: Pixel | undefined; exposure: number }) {
  const { library, view, name } = usePage();
  const rows: { id: string; badge?: "a" | "b" }[] = [
    { id: view.a, badge: "a" },
    { id: view.b, badge: "b" },
    { id: REFERENCE },
  ];
  const valueOf = (kind: (typeof ERROR_KINDS)[number], id: string, base: string) => {
    const map = pixel && id !== base ? library.difference(kind, view.scene, view.spp, id, base, exposure) : undefined;
    const error = map?.[pixel!.y * library.size(view.scene)!.width + pixel!.x];
    return error === undefined ? "–" : ERRORS[kind].signed ? signed(error) : number(error);
  };
  const at = (id: string) => (pixel ? library.get(view.scene, view.spp, id)?.rgb(pixel.x, pixel.y) : undefined);
  const [ofA, ofB] = [at(view.a), at(view.b)];
  return (
    <div class="scroll" tabIndex={0} role="region" aria-label="Values of a pixel">
      <table class="probe">
        <caption>
          {pixel ? (
            <>
              Pixel{" "}
              <b class="where">
                {pixel.x}, {pixel.y}
              </b>
            </>
          ) : (
            "Point at a picture for its values"
          )}
        </caption>
        <thead>
          <tr>
            <th scope="col">Linear Rec. 709</th>
            <th scope="col">R</th>
            <th scope="col">G</th>
            <th scope="col">B</th>
            <th scope="col">Luminance</th>
            {ERROR_KINDS.map((kind) => (
              <th key={kind} scope="col">
                {ERRORS[kind].short}
              </th>
            ))}
          </tr>
        </thead>
        <tbody>
          {rows.map(({ id, badge }, i) => {
            const rgb = at(id);
            return (
              <tr key={i}>
                <th scope="row">
                  {badge && <span class={`badge ${badge}`}>{badge.toUpperCase()}</span>} {name(id)}
                </th>
                {[0, 1, 2].map((c) => (
                  <td key={c}>{rgb ? number(rgb[c]) : "–"}</td>
                ))}
                <td>{rgb ? number(luminance(...rgb)) : "–"}</td>
                {ERROR_KINDS.map((kind) => (
                  <td key={kind}>{valueOf(kind, id, REFERENCE)}</td>
                ))}
              </tr>
            );
          })}
          {view.show === "difference" && (
            <tr class="minus">
              <th scope="row">A − B</th>
              {[0, 1, 2].map((c) => (
                <td key={c}>{ofA && ofB ? signed(ofA[c]! - ofB[c]!) : "–"}</td>
              ))}
              <td>{ofA && ofB ? signed(luminance(...ofA) - luminance(...ofB)) : "–"}</td>
              {ERROR_KINDS.map((kind) => (
                <td key={kind}>{valueOf(kind, view.a, view.b)}</td>
              ))}
            </tr>
          )}
        </tbody>
      </table>
    </div>
  );
}
