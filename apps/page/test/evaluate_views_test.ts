// Every view of the page of brume evaluate: accessible, as wide as its window, printed.
import assert from "node:assert/strict";
import { join } from "node:path";
import test, { describe } from "node:test";
import { comesTo, drawn, violations } from "./browser";
import { DESKTOP, PHONE, folder, judgeWhatPagesSaid, load, made, open, reader } from "./evaluate_page";

const VIEWS: Record<string, string> = {
  swipe: "",
  swipe_error: "show=error",
  flip: "mode=flip",
  grid: "mode=grid",
  grid_error: "mode=grid&show=error&error=luminance",
  difference: "show=difference&error=luminance",
  grid_difference: "mode=grid&show=difference&error=luminance",
  zoomed: "zoom=5&x=0.4&y=0.45",
  numbers: "tab=numbers",
  numbers_all: "tab=numbers&setting=&scene=smoke",
  plots: "tab=plots",
  ablation: "tab=ablation",
  sensitivity: "tab=sensitivity",
  about: "tab=about",
};

describe("every view", () => {
  for (const [device, viewport] of [
    ["desktop", DESKTOP],
    ["phone", PHONE],
  ] as const)
    for (const scheme of ["light", "dark"] as const)
      test(`is accessible and fits a ${device} in ${scheme} colours`, async () => {
        const context = await reader(viewport, scheme);
        const page = await open(context, made);
        const found: string[] = [];
        for (const [name, hash] of Object.entries(VIEWS)) {
          await load(page, made, hash);
          for (const canvas of await page.locator(".pane canvas").all()) await drawn(canvas);
          await page.screenshot({ path: join(folder, `${device}_${scheme}_${name}.png`), fullPage: true });
          const wide = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
          if (wide > 0) found.push(`${name} is ${wide} pixels wider than the ${device}`);
          // What depends on the size does not on the colours.
          if (device === "desktop" || scheme === "light") found.push(...(await violations(page, name)));
        }
        await load(page, made, "");
        await page.keyboard.press("?");
        await page.getByRole("dialog").waitFor({ state: "visible" });
        await page.screenshot({ path: join(folder, `${device}_${scheme}_help.png`) });
        found.push(...(await violations(page, "help")));
        await context.close();
        assert.deepEqual(found, []);
      });

  test("can be printed", async () => {
    const context = await reader({ width: 794, height: 1123 }, "dark");
    const page = await open(context, made);
    for (const name of ["swipe", "grid", "numbers", "plots", "about"]) {
      await page.emulateMedia({ media: null });
      await load(page, made, VIEWS[name]!);
      for (const canvas of await page.locator(".pane canvas").all()) await drawn(canvas);
      await page.emulateMedia({ media: "print" });
      await page.screenshot({ path: join(folder, `print_${name}.png`), fullPage: true });
      await page.locator(".methods").waitFor({ state: "hidden" });
      const ground = () => page.evaluate(() => getComputedStyle(document.documentElement).backgroundColor);
      await comesTo(ground, "rgb(255, 255, 255)");
    }
    await context.close();
  });
});

judgeWhatPagesSaid();
