// The picture, as large as there is room for it.
import { useEffect, useLayoutEffect, useRef, useState } from "preact/hooks";
import { cssGradient, EMBER, luminance } from "../color";
import { Divider } from "../divider";
import { number } from "../format";
import { floatOfHalf } from "../half";
import { useSize } from "../pane";
import { useViewer } from "./context";
import type { Drawn } from "./display";
import { listen, type Rect } from "./gestures";
import { useTopic } from "./topic";
import type { Viewer } from "./viewer";

interface Place {
  x: number;
  y: number;
}

/** Where the picture lies in an area: all of it, but for bars where their shapes differ by more than a rounded pixel. */
export function pictureRect(area: { width: number; height: number }, aspect: number): Rect {
  const ratio = area.width / area.height / aspect;
  if (Math.abs(ratio - 1) < 0.02) return { left: 0, top: 0, ...area };
  const [width, height] = ratio > 1 ? [area.height * aspect, area.height] : [area.width, area.width / aspect];
  return { left: (area.width - width) / 2, top: (area.height - height) / 2, width, height };
}

function aspectOf(viewer: Viewer): number {
  const picture = viewer.shown(viewer.settings.layer)?.picture;
  return picture ? picture.width / picture.height : viewer.aspect;
}

export function Stage() {
  const viewer = useViewer();
  const box = useRef<HTMLDivElement>(null);
  const canvas = useRef<HTMLCanvasElement>(null);
  const size = useSize(box);
  const [pointer, setPointer] = useState<Place | undefined>();
  const [keyboard, setKeyboard] = useState(false);
  const area = useRef(size);
  area.current = size;

  useEffect(() => {
    if (size.width && size.height) viewer.resize(size);
  }, [size]);
  useEffect(() => listen(canvas.current!, viewer, () => pictureRect(area.current, aspectOf(viewer)), setPointer), []);
  useLayoutEffect(() => {
    draw(canvas.current!, area.current, viewer);
  });
  useEffect(() => {
    let scheduled = 0;
    const later = () => {
      scheduled ||= requestAnimationFrame(() => {
        scheduled = 0;
        draw(canvas.current!, area.current, viewer);
      });
    };
    return viewer.arrived.subscribe(later);
  }, []);

  const { layers, settings, tool } = viewer;
  const titles = layers.map((name) => viewer.layerTitle(name));
  const rect = size.width && size.height ? pictureRect(size, aspectOf(viewer)) : undefined;
  return (
    <div class={`stage tool-${tool}`} ref={box}>
      <canvas
        ref={canvas}
        id="picture"
        tabIndex={0}
        role="img"
        aria-label={`${viewer.scene?.name ?? "volume"}: ${titles.join(" and ")}${viewer.ofFrames ? "" : "; drag to turn"}`}
        onFocus={(e) => setKeyboard(e.currentTarget.matches(":focus-visible"))}
        onBlur={() => setKeyboard(false)}
        onPointerMove={() => setKeyboard(false)}
      />
      {keyboard && <span class="cross" aria-hidden="true" />}
      {layers.length === 2 && rect && (
        <div class="over" style={{ left: `${rect.left}px`, width: `${rect.width}px` }}>
          <Divider
            label={`Divider between ${titles[0]} and ${titles[1]}`}
            split={settings.split}
            onStep={(by) => viewer.set({ split: Math.min(1, Math.max(0, viewer.settings.split + by)) })}
          />
        </div>
      )}
      <Labels titles={titles} />
      <Corner pointer={keyboard ? { x: 0.5, y: 0.5 } : pointer} />
    </div>
  );
}

/** What is seen where it is not plain: two layers, and a layer that is not there yet. */
function Labels({ titles }: { titles: string[] }) {
  const viewer = useViewer();
  useTopic(viewer.arrived);
  const { layers, settings, missing } = viewer;
  const seen = layers.map((name) => viewer.shown(name)?.picture.layer);
  const two = layers.length === 2;
  return (
    <>
      {layers.map((name, i) => {
        const stands = seen[i] !== undefined && seen[i] !== name;
        const unmixed = viewer.shown(name)?.picture.mixed === false;
        if (!two && !stands && !unmixed) return null;
        return (
          <p key={name} class={`corner ${i ? "right" : "left"}`}>
            {stands ? `${viewer.layerTitle(seen[i]!)}; ${titles[i]} is not there yet` : titles[i]}
            {unmixed && ": lights as rendered, not mixed"}
          </p>
        );
      })}
      {layers.map((name, i) => {
        if (!missing.includes(name) || seen[i] !== undefined || (name === "picture" && !two)) return null;
        const [from, to] = two ? (i ? [settings.split, 1] : [0, settings.split]) : [0, 1];
        return (
          <p key={name} class="missing" style={{ left: `${50 * (from + to)}%`, maxWidth: `${100 * (to - from)}%` }}>
            {titles[i]}: not there yet
            {WITH_SAMPLES.test(name) && <small>It comes with the first samples.</small>}
          </p>
        );
      })}
    </>
  );
}

/** Layers that no prediction has. */
const WITH_SAMPLES = /^(noisy|clean_error|sample_count)$/;

function draw(canvas: HTMLCanvasElement, area: { width: number; height: number }, viewer: Viewer): void {
  const ratio = window.devicePixelRatio || 1;
  const [width, height] = [Math.round(area.width * ratio), Math.round(area.height * ratio)];
  if (!width || !height) return;
  if (canvas.width !== width || canvas.height !== height) {
    canvas.width = width;
    canvas.height = height;
  }
  const context = canvas.getContext("2d")!;
  context.clearRect(0, 0, width, height);
  paint(context, pictureRect({ width, height }, aspectOf(viewer)), viewer);
}

/** Draws the layers into a rectangle, on both sides of the divider where there are two. */
export function paint(context: CanvasRenderingContext2D, rect: Rect, viewer: Viewer): void {
  const { layers, settings } = viewer;
  const middle = layers.length === 2 ? Math.round(settings.split * rect.width) : rect.width;
  layers.forEach((name, i) => {
    const drawn = viewer.shown(name);
    if (!drawn) return;
    const source = drawn.with({ tone: viewer.tone, stops: settings.stops }, viewer.screen);
    context.save();
    context.beginPath();
    context.rect(rect.left + (i ? middle : 0), rect.top, i ? rect.width - middle : middle, rect.height);
    context.clip();
    context.imageSmoothingEnabled = source.width !== rect.width || source.height !== rect.height;
    context.imageSmoothingQuality = "high";
    context.drawImage(source, rect.left, rect.top, rect.width, rect.height);
    context.restore();
  });
}

/** Linear values of a layer at a place. */
export function valuesAt({ picture }: Drawn, { x, y }: Place): number[] {
  const { width, height, channels, half } = picture;
  const column = Math.min(width - 1, Math.max(0, Math.floor(x * width)));
  const row = Math.min(height - 1, Math.max(0, Math.floor(y * height)));
  return Array.from({ length: channels }, (_, c) => floatOfHalf(half[c * width * height + row * width + column]!));
}

/** Values under the pointer, and the legend of false colours. */
function Corner({ pointer }: { pointer: Place | undefined }) {
  const viewer = useViewer();
  useTopic(viewer.arrived);
  const falseColours = viewer.layers.flatMap((name) => {
    const drawn = viewer.shown(name);
    const layer = drawn?.picture.layer ?? "";
    const unit = viewer.layerUnit(layer);
    return drawn?.picture.channels === 1 ? [{ name: viewer.layerTitle(layer), unit, drawn }] : [];
  });
  const right = viewer.layers.length === 2 && pointer && pointer.x > viewer.settings.split;
  const name = right ? viewer.settings.other : viewer.settings.layer;
  const drawn = viewer.shown(name);
  const values = pointer && drawn ? valuesAt(drawn, pointer) : undefined;
  return (
    <div class="foot">
      {falseColours.map(({ name, unit, drawn: { range } }) => (
        <div key={name} class="legend" data-layer={name}>
          <span>
            {name}
            {unit && <small> [{unit}]</small>}
          </span>
          <div class="ramp">
            <div class="bar" style={{ background: cssGradient(EMBER) }} />
            <div class="ticks">
              <span>{number(range[0])}</span>
              <span>{number((range[0] + range[1]) / 2)}</span>
              <span>{number(range[1])}</span>
            </div>
          </div>
        </div>
      ))}
      {values && drawn && pointer && (
        <p class="value">
          <span class="where">
            {Math.floor(pointer.x * drawn.picture.width)}, {Math.floor(pointer.y * drawn.picture.height)}
          </span>
          {values.length === 3 ? (
            <>
              {(["R", "G", "B"] as const).map((c, i) => (
                <span key={c}>
                  <small>{c}</small> {number(values[i])}
                </span>
              ))}
              <span>
                <small>luminance</small> {number(luminance(values[0]!, values[1]!, values[2]!))}
              </span>
            </>
          ) : (
            <span>
              <small>{viewer.layerTitle(drawn.picture.layer)}</small> {number(values[0])}
              <small> {viewer.layerUnit(drawn.picture.layer)}</small>
            </span>
          )}
        </p>
      )}
    </div>
  );
}
