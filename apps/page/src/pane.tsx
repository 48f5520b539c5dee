// One canvas with one picture, or two with a divider between them, to be zoomed and dragged.
import { useEffect, useLayoutEffect, useRef, useState } from "preact/hooks";
import type { RefObject } from "preact";
import { contained, movedBy, pixelAt, showsAll, transform, zoomedAt, type Size, type Viewport } from "./viewport";

export interface Pixel {
  x: number;
  y: number;
}

interface Props {
  /** Canvases of the pictures' own size; the second lies right of the divider. Missing ones are not there yet. */
  left: HTMLCanvasElement | undefined;
  right?: HTMLCanvasElement | undefined;
  /** The divider's place, 0 to 1, where there are two pictures. */
  split?: number;
  picture: Size;
  view: Viewport;
  label: string;
  /** A pixel to mark, as the one under the pointer in another pane. */
  mark?: Pixel | undefined;
  /** Called with the step from a view to the next: moves that come between two drawings add up. */
  onView: (step: (view: Viewport) => Viewport) => void;
  onSplit?: (split: number) => void;
  onProbe: (pixel: Pixel | undefined) => void;
  onTap?: () => void;
  onSize?: (pane: Size) => void;
}

/** The size of an element in CSS pixels, kept up to date. */
export function useSize(ref: RefObject<HTMLElement | null>): Size {
  const [size, setSize] = useState<Size>({ width: 0, height: 0 });
  useLayoutEffect(() => {
    const element = ref.current;
    if (!element) return;
    const measure = () => {
      const { clientWidth: width, clientHeight: height } = element;
      setSize((old) => (old.width === width && old.height === height ? old : { width, height }));
    };
    measure();
    const observer = new ResizeObserver(measure);
    observer.observe(element);
    return () => observer.disconnect();
  }, []);
  return size;
}

export function Pane(props: Props) {
  const box = useRef<HTMLDivElement>(null);
  const canvas = useRef<HTMLCanvasElement>(null);
  const size = useSize(box);
  const [keyboard, setKeyboard] = useState(false);
  const latest = useRef({ props, size });
  latest.current = { props, size };

  useEffect(() => props.onSize?.(size), [size]);
  useLayoutEffect(() => {
    if (canvas.current && size.width && size.height) draw(canvas.current, size, props, keyboard);
  });
  // With the keyboard on the picture, the pixel in the middle is looked at.
  useEffect(() => {
    if (keyboard) props.onProbe(pixelAt(props.view, size.width / 2, size.height / 2, props.picture, size));
  }, [keyboard, props.view.x, props.view.y, props.view.zoom, size]);
  useEffect(() => listen(canvas.current!, () => latest.current), []);

  return (
    <div class="pane" ref={box}>
      <canvas
        ref={canvas}
        tabIndex={0}
        role="img"
        onFocus={(e) => setKeyboard(e.currentTarget.matches(":focus-visible"))}
        onBlur={() => setKeyboard(false)}
        onPointerMove={() => setKeyboard(false)}
        aria-label={props.label}
        style={{ touchAction: showsAll(props.view) ? "pan-y" : "none", cursor: props.onTap ? "pointer" : "crosshair" }}
      />
    </div>
  );
}

function draw(
  canvas: HTMLCanvasElement,
  size: Size,
  { left, right, split = 1, picture, view, mark }: Props,
  keyboard: boolean,
): void {
  const ratio = window.devicePixelRatio || 1;
  const width = Math.round(size.width * ratio);
  const height = Math.round(size.height * ratio);
  if (canvas.width !== width || canvas.height !== height) {
    canvas.width = width;
    canvas.height = height;
  }
  const context = canvas.getContext("2d")!;
  context.clearRect(0, 0, width, height);
  const at = transform(view, picture, { width, height });
  context.imageSmoothingEnabled = at.scale < 1;
  context.imageSmoothingQuality = "high";
  const part = (source: HTMLCanvasElement | undefined, from: number, to: number) => {
    if (!source || to <= from) return;
    context.save();
    context.beginPath();
    context.rect(from, 0, to - from, height);
    context.clip();
    context.drawImage(source, at.left, at.top, picture.width * at.scale, picture.height * at.scale);
    context.restore();
  };
  const middle = Math.round(split * width);
  part(left, 0, middle);
  part(right, middle, width);
  const marked = keyboard ? pixelAt(view, width / 2, height / 2, picture, { width, height }) : mark;
  if (marked) {
    const edge = Math.max(at.scale, 5 * ratio);
    const x = at.left + (marked.x + 0.5) * at.scale - edge / 2;
    const y = at.top + (marked.y + 0.5) * at.scale - edge / 2;
    for (const [colour, line] of [
      ["#000", 3 * ratio],
      ["#fff", ratio],
    ] as const) {
      context.strokeStyle = colour;
      context.lineWidth = line;
      context.strokeRect(x, y, edge, edge);
    }
  }
}

/** Pointers, wheel and double click on a pane; `now` gives its latest properties. */
function listen(canvas: HTMLCanvasElement, now: () => { props: Props; size: Size }): () => void {
  const pointers = new Map<number, { x: number; y: number }>();
  let travelled = 0;
  let dragsDivider = false;

  const place = (event: MouseEvent) => {
    const frame = canvas.getBoundingClientRect();
    return { x: event.clientX - frame.left, y: event.clientY - frame.top };
  };
  const probe = (point: { x: number; y: number }) => {
    const { props, size } = now();
    props.onProbe(pixelAt(props.view, point.x, point.y, props.picture, size));
  };
  const divide = (x: number) => {
    const { props, size } = now();
    props.onSplit?.(Math.min(1, Math.max(0, x / size.width)));
  };

  const down = (event: PointerEvent) => {
    if (event.button !== 0) return;
    const point = place(event);
    pointers.set(event.pointerId, point);
    canvas.setPointerCapture(event.pointerId);
    const { props, size } = now();
    if (pointers.size === 1) {
      travelled = 0;
      // With nothing to drag the picture for, a drag anywhere moves the divider.
      dragsDivider =
        !!props.onSplit && (showsAll(props.view) || Math.abs(point.x - (props.split ?? 1) * size.width) < 16);
    }
    probe(point);
  };
  const move = (event: PointerEvent) => {
    const point = place(event);
    const before = pointers.get(event.pointerId);
    probe(point);
    if (!before) return;
    const { props, size } = now();
    const [dx, dy] = [point.x - before.x, point.y - before.y];
    travelled += Math.hypot(dx, dy);
    if (pointers.size === 2) {
      const other = [...pointers].find(([id]) => id !== event.pointerId)![1];
      const factor =
        Math.hypot(point.x - other.x, point.y - other.y) /
        Math.max(1, Math.hypot(before.x - other.x, before.y - other.y));
      const [x, y] = [(point.x + other.x) / 2, (point.y + other.y) / 2];
      props.onView((v) =>
        zoomedAt(movedBy(v, dx / 2, dy / 2, props.picture, size), factor, x, y, props.picture, size),
      );
    } else if (dragsDivider) divide(point.x);
    else props.onView((v) => movedBy(v, dx, dy, props.picture, size));
    pointers.set(event.pointerId, point);
  };
  const up = (event: PointerEvent) => {
    if (!pointers.delete(event.pointerId)) return;
    if (event.type === "pointerup" && pointers.size === 0 && travelled < 4) {
      if (dragsDivider) divide(place(event).x);
      now().props.onTap?.();
    }
  };
  // A finger that is lifted leaves its values to be read.
  const leave = (event: PointerEvent) => {
    if (event.pointerType !== "touch") now().props.onProbe(undefined);
  };
  const wheel = (event: WheelEvent) => {
    event.preventDefault();
    const { props, size } = now();
    const { x, y } = place(event);
    const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 30 : 1;
    const factor = Math.exp(-event.deltaY * lines * 0.0015);
    props.onView((v) => zoomedAt(v, factor, x, y, props.picture, size));
  };
  const whole = () => {
    const { props, size } = now();
    if (!props.onTap)
      props.onView((v) => contained({ x: 0.5, y: 0.5, zoom: showsAll(v) ? 4 : 1 }, props.picture, size));
  };

  const listening = new AbortController();
  const { signal } = listening;
  canvas.addEventListener("pointerdown", down, { signal });
  canvas.addEventListener("pointermove", move, { signal });
  canvas.addEventListener("pointerup", up, { signal });
  canvas.addEventListener("pointercancel", up, { signal });
  canvas.addEventListener("pointerleave", leave, { signal });
  canvas.addEventListener("wheel", wheel, { signal, passive: false });
  canvas.addEventListener("dblclick", whole, { signal });
  return () => listening.abort();
}
