// What tests of both pages do with a real browser.
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { join } from "node:path";
import { isDeepStrictEqual } from "node:util";
import type { AxeResults } from "axe-core";
import type { Locator, Page } from "playwright-core";

declare const PAGE_FOLDER: string;
const modules = createRequire(join(PAGE_FOLDER, "package.json"));
export const { chromium } = modules("playwright-core") as typeof import("playwright-core");
const axe = readFileSync(modules.resolve("axe-core/axe.min.js"), "utf8");

/** The canvas' pixels, as text to compare. */
export async function pixels(canvas: Locator): Promise<string> {
  return canvas.evaluate((c) => (c as HTMLCanvasElement).toDataURL());
}

/** Red, green, blue and alpha in its middle; read from a copy, as browsers warn of canvases that are read often. */
export async function middleOf(canvas: Locator): Promise<number[]> {
  return canvas.evaluate((c) => {
    const { width, height } = c as HTMLCanvasElement;
    const middle = new OffscreenCanvas(1, 1).getContext("2d", { willReadFrequently: true })!;
    if (width) middle.drawImage(c as HTMLCanvasElement, -Math.floor(width / 2), -Math.floor(height / 2));
    return [...middle.getImageData(0, 0, 1, 1).data];
  });
}

/** Waits until a canvas shows something, and something else than `before`. */
export async function drawn(canvas: Locator, before = ""): Promise<string> {
  for (let i = 0; i < 600; ++i) {
    const now = await pixels(canvas);
    const empty = !(await middleOf(canvas))[3];
    if (!empty && now !== before) return now;
    await new Promise((resolve) => setTimeout(resolve, 50));
  }
  throw new Error("the picture did not change");
}

/** Waits until the page shows what it should: it draws itself anew a while after a key or a click. */
export async function comesTo<T>(read: () => Promise<T>, wanted: T, what = ""): Promise<void> {
  for (let i = 0; i < 400; ++i) {
    if (isDeepStrictEqual(await read(), wanted)) return;
    await new Promise((resolve) => setTimeout(resolve, 50));
  }
  assert.deepEqual(await read(), wanted, what);
}

/** What axe finds. */
export async function violations(page: Page, what: string): Promise<string[]> {
  await page.evaluate(axe);
  const found = (await page.evaluate("axe.run(document, { resultTypes: ['violations'] })")) as AxeResults;
  return found.violations.map(
    (v) => `${what}: ${v.id}: ${v.help}: ${v.nodes.map((n) => n.target.join(" ")).join("; ")}`,
  );
}
