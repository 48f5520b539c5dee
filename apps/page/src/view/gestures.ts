// Pointers and the wheel on the picture: camera, sun, lamp and divider.
import { addLamp, focusAt, turnSun } from "./actions";
import { dolly, orbit, pan, zoom } from "./camera";
import type { Viewer } from "./viewer";

export interface Rect {
  left: number;
  top: number;
  width: number;
  height: number;
}

type Mode = "orbit" | "pan" | "sun" | "divider";

/** Distance from the divider at which a drag takes it [CSS px]. */
const NEAR = 14;

/** @param rect  of the picture in the canvas, CSS pixels
 *  @param point  told the place in the picture under the pointer, 0 to 1; nothing outside
 *  @returns what ends it */
export function listen(
  canvas: HTMLCanvasElement,
  viewer: Viewer,
  rect: () => Rect,
  point: (at: { x: number; y: number } | undefined) => void,
): () => void {
  const pointers = new Map<number, { x: number; y: number }>();
  let mode: Mode = "orbit";
  let travelled = 0;
  let drags = 0;
  let controlHeld = false;

  const place = (event: MouseEvent) => {
    const frame = canvas.getBoundingClientRect();
    return { x: event.clientX - frame.left, y: event.clientY - frame.top };
  };
  const relative = (at: { x: number; y: number }) => {
    const { left, top, width, height } = rect();
    return { x: (at.x - left) / width, y: (at.y - top) / height };
  };
  const inside = ({ x, y }: { x: number; y: number }) => x >= 0 && x < 1 && y >= 0 && y < 1;
  const tell = (at: { x: number; y: number }) => {
    const r = relative(at);
    point(inside(r) ? r : undefined);
  };
  const atDivider = (x: number) => {
    const { left, width } = rect();
    return viewer.layers.length === 2 && Math.abs(x - left - viewer.settings.split * width) < NEAR;
  };

  const down = (event: PointerEvent) => {
    const at = place(event);
    pointers.set(event.pointerId, at);
    canvas.setPointerCapture(event.pointerId);
    tell(at);
    if (pointers.size > 1) return;
    ++drags;
    travelled = 0;
    if (event.button === 0 && atDivider(at.x)) mode = "divider";
    else if (event.button !== 0 || event.shiftKey) mode = "pan";
    else mode = viewer.tool === "sun" ? "sun" : "orbit";
  };
  const move = (event: PointerEvent) => {
    const at = place(event);
    const before = pointers.get(event.pointerId);
    tell(at);
    if (!before) {
      canvas.classList.toggle("divides", atDivider(at.x));
      return;
    }
    const { width, height } = rect();
    const [dx, dy] = [at.x - before.x, at.y - before.y];
    travelled += Math.hypot(dx, dy);
    pointers.set(event.pointerId, at);
    // A click that trembles is no drag.
    if (travelled < 3) return;
    const step = `drag ${drags}`;
    const half = Math.PI / height;
    if (pointers.size === 2) {
      const other = [...pointers].find(([id]) => id !== event.pointerId)![1];
      const apart = (p: { x: number; y: number }) => Math.max(8, Math.hypot(p.x - other.x, p.y - other.y));
      viewer.moveCamera(
        (c) => dolly(pan(c, -dx / 2 / height, dy / 2 / height, viewer.aspect), apart(before) / apart(at)),
        step,
      );
    } else if (mode === "divider") viewer.set({ split: Math.min(1, Math.max(0, viewer.settings.split + dx / width)) });
    else if (mode === "pan") viewer.moveCamera((c) => pan(c, -dx / height, dy / height, viewer.aspect), step);
    else if (mode === "sun") turnSun(viewer, dx * half, dy * half, step);
    else viewer.moveCamera((c) => orbit(c, -dx * half, dy * half), step);
  };
  const up = (event: PointerEvent) => {
    if (!pointers.delete(event.pointerId) || pointers.size > 0) return;
    viewer.settle();
    if (event.type !== "pointerup" || travelled >= 3 || event.button !== 0) return;
    const at = relative(place(event));
    if (viewer.tool === "lamp" && inside(at)) void addLamp(viewer, at.x, at.y);
  };
  // A finger that is lifted leaves its values to be read.
  const leave = (event: PointerEvent) => {
    if (event.pointerType !== "touch") point(undefined);
  };
  const wheel = (event: WheelEvent) => {
    event.preventDefault();
    const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 30 : 1;
    const factor = Math.exp(Math.min(300, Math.max(-300, event.deltaY * lines)) * 0.0012);
    // Two fingers on a touchpad come as a wheel with ctrlKey although nobody holds the key.
    const pinch = event.ctrlKey && !controlHeld;
    viewer.nudge(() =>
      viewer.moveCamera(
        (c) => (event.ctrlKey && !pinch ? zoom(c, factor) : dolly(c, pinch ? factor ** 6 : factor)),
        "wheel",
      ),
    );
  };
  const double = (event: MouseEvent) => {
    const at = relative(place(event));
    if (viewer.tool === "camera" && inside(at) && !atDivider(place(event).x)) void focusAt(viewer, at.x, at.y);
  };
  const key = (event: KeyboardEvent) => {
    controlHeld = event.ctrlKey;
  };

  const listening = new AbortController();
  const { signal } = listening;
  canvas.addEventListener("pointerdown", down, { signal });
  canvas.addEventListener("pointermove", move, { signal });
  canvas.addEventListener("pointerup", up, { signal });
  canvas.addEventListener("pointercancel", up, { signal });
  canvas.addEventListener("pointerleave", leave, { signal });
  canvas.addEventListener("wheel", wheel, { signal, passive: false });
  canvas.addEventListener("dblclick", double, { signal });
  canvas.addEventListener("contextmenu", (event) => event.preventDefault(), { signal });
  addEventListener("keydown", key, { signal });
  addEventListener("keyup", key, { signal });
  return () => listening.abort();
}
