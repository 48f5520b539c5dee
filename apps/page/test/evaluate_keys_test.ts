// Keys that do nothing now say why.
import assert from "node:assert/strict";
import test, { describe } from "node:test";
import { pathToFileURL } from "node:url";
import { comesTo, drawn } from "./browser";
import { judgeWhatPagesSaid, made, open, pageOf, reader } from "./evaluate_page";
import { fixture } from "./fixture";

describe("keys that do nothing now", () => {
  const NOTHING: [hash: string, key: string, why: RegExp][] = [
    ["mode=flip", "ArrowLeft", /divider is of swipe/],
    ["split=1", "ArrowRight", /at the edge/],
    ["mode=grid", "ArrowRight", /divider is of swipe/],
    ["show=difference", "ArrowLeft", /no divider/],
    ["show=difference", " ", /one picture/],
    ["a=noisy&b=noisy", " ", /are the same/],
    ["a=noisy&b=noisy", "x", /are the same/],
    ["a=noisy&b=noisy", "g", /are the same/],
    ["a=reference", "r", /A is the reference/],
    ["a=reference&b=reference", "e", /no error/],
    ["show=error", "[", /does not change error maps/],
    ["tab=numbers", "]", /Exposure is of the pictures/],
    ["stops=12", "]", /12 stops/],
    ["", "\\", /scene's exposure/],
    ["show=error&gain=8", ">", /as long as it gets/],
    ["tab=plots", "+", /Zoom is of the pictures/],
    ["tab=plots", "0", /Zoom is of the pictures/],
    ["tab=plots", "w", /Zoom is of the pictures/],
    ["zoom=64", "+", /as close/],
    ["", "0", /All of the picture is seen/],
    ["", "d", /All of the picture is seen/],
    ["zoom=4&y=0.875", "s", /picture ends/],
    ["", ",", /4, 16 samples per pixel, no fewer/],
    ["spp=16", ".", /no more/],
    ["", "l", /This is look/],
    ["mode=grid", "3", /This is grid/],
  ];
  test("say why", async () => {
    const context = await reader();
    const page = await open(context, made);
    for (const [hash, key, why] of NOTHING) {
      await page.goto("about:blank");
      await page.goto(pathToFileURL(made).href + `#${hash}`);
      if (hash.includes("tab=")) await page.locator(".answer .one").first().waitFor();
      else await drawn(page.locator("canvas").first());
      assert.equal(await page.locator(".message").textContent(), "", hash);
      await page.keyboard.press(key);
      await comesTo(async () => why.test((await page.locator(".message").textContent())!), true, `${key} at ${hash}`);
    }
    await context.close();
  });

  test("say why of an evaluation that has one of everything", async () => {
    const { results } = fixture();
    const few = {
      scenes: results.scenes.slice(0, 1),
      spp: [4],
      methods: results.methods,
      rows: results.rows.filter((r) => r.scene === "cloud" && r.spp === 4 && r.region === "frame"),
      metrics: results.metrics.slice(0, 1),
    };
    const single = pageOf("single.html", few);
    const context = await reader();
    const page = await open(context, single);
    for (const [key, why] of [
      ["m", /one scene/],
      ["f", /the whole frame only/],
      ["c", /one metric/],
      [".", /no more/],
      ["b", /No layer was left out/],
      ["v", /No parameter was varied/],
    ] as const) {
      await page.keyboard.press(key);
      await comesTo(async () => why.test((await page.locator(".message").textContent())!), true, key);
    }
    await context.close();
  });
});

judgeWhatPagesSaid();
