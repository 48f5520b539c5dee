// Looking at pictures: divider, zoom, values, links, the grid, differences.
import assert from "node:assert/strict";
import test, { describe } from "node:test";
import { comesTo, drawn, middleOf, pixels } from "./browser";
import { judgeWhatPagesSaid, linkOnce, linkSays, made, open, reader } from "./evaluate_page";

describe("looking at pictures", () => {
  test("the divider follows keys and pointer", async () => {
    const context = await reader();
    const page = await open(context, made);
    const canvas = page.locator(".stage canvas");
    const first = await drawn(canvas);
    await page.keyboard.press("ArrowLeft");
    await page.keyboard.press("ArrowLeft");
    const second = await drawn(canvas, first);
    await linkSays(page, "split", "0.46");
    const box = (await canvas.boundingBox())!;
    await page.mouse.move(box.x + box.width / 2, box.y + 200);
    await page.mouse.down();
    await page.mouse.move(box.x + box.width / 4, box.y + 200, { steps: 4 });
    await page.mouse.up();
    await drawn(canvas, second);
    await linkOnce(page, (link) => Math.abs(Number(link.get("split")) - 0.25) < 0.01);
    await page.getByRole("separator").focus();
    await page.keyboard.press("End");
    await linkSays(page, "split", "1");
    await context.close();
  });

  test("the wheel zooms at the pointer, a drag moves, 0 shows all again", async () => {
    const context = await reader();
    const page = await open(context, made);
    const canvas = page.locator(".stage canvas");
    const whole = await drawn(canvas);
    const box = (await canvas.boundingBox())!;
    await page.mouse.move(box.x + box.width * 0.6, box.y + box.height * 0.4);
    const where = page.locator(".probe .where");
    const pixel = await where.textContent();
    await page.mouse.wheel(0, -900);
    const close = await drawn(canvas, whole);
    await comesTo(() => where.textContent(), pixel);
    await linkOnce(page, (link) => Number(link.get("zoom")) > 2);
    await page.mouse.move(box.x + box.width * 0.8, box.y + box.height * 0.5);
    await page.mouse.down();
    await page.mouse.move(box.x + box.width * 0.7, box.y + box.height * 0.6, { steps: 3 });
    await page.mouse.up();
    await drawn(canvas, close);
    await page.keyboard.press("0");
    await linkOnce(page, (link) => link.get("zoom") === null && link.get("x") === null);
    await context.close();
  });

  test("values under the pointer are those of the picture", async () => {
    const context = await reader();
    const page = await open(context, made);
    const canvas = page.locator(".stage canvas");
    await drawn(canvas);
    const box = (await canvas.boundingBox())!;
    await page.mouse.move(box.x + box.width / 2 + 1, box.y + box.height / 2 + 1);
    await comesTo(() => page.locator(".probe .where").textContent(), "20, 15");
    // The made-up ball is brightest there: 0.2 + 0.6 in red.
    const cells = page.locator(".probe tbody tr").nth(2).locator("td");
    await comesTo(() => cells.nth(0).textContent(), "0.800");
    await comesTo(() => cells.nth(1).textContent(), "0.850");
    await context.close();
  });

  test("with the keyboard on the picture the pixel in the middle is read", async () => {
    const context = await reader();
    const page = await open(context, made);
    await drawn(page.locator(".stage canvas"));
    await page.keyboard.press("Tab");
    await page.locator(".stage canvas").focus();
    await comesTo(() => page.locator(".probe .where").textContent(), "20, 15");
    for (const key of ["+", "+", "+", "+", "d"]) await page.keyboard.press(key);
    await page.waitForFunction(() => document.querySelector(".probe .where")?.textContent !== "20, 15");
    await context.close();
  });

  test("keys do what the help says", async () => {
    const context = await reader();
    const page = await open(context, made);
    const canvas = page.locator("canvas").first();
    const first = await drawn(canvas);
    const press = async (...keys: string[]) => {
      for (const key of keys) await page.keyboard.press(key);
    };
    const turns = async (keys: string[], name: string, value: string | null) => {
      await press(...keys);
      await linkSays(page, name, value);
    };
    await turns(["ArrowDown"], "b", "nl_means_searched");
    await turns(["Shift+ArrowUp"], "a", "bilateral_searched");
    await turns(["x"], "a", "nl_means_searched");
    await turns(["r"], "a", "reference");
    await turns(["]", "]"], "stops", "1");
    await turns(["\\"], "stops", null);
    await turns(["t"], "tone", "filmic");
    await turns(["e"], "show", "error");
    await turns(["k"], "error", "luminance");
    await turns([">"], "gain", "1");
    await turns(["2"], "mode", "flip");
    await turns([" "], "front", "a");
    await turns(["3"], "mode", "grid");
    await comesTo(() => page.locator(".tile").count(), 6);
    await turns(["."], "spp", "16");
    await turns(["m"], "scene", "smoke");
    await turns(["f"], "region", "frame");
    await turns(["c"], "metric", "psnr");
    for (const [key, tab] of [
      ["n", "numbers"],
      ["p", "plots"],
      ["b", "ablation"],
      ["v", "sensitivity"],
      ["i", "about"],
    ] as const)
      await turns([key], "tab", tab);
    await press("l", "?");
    const dialog = page.getByRole("dialog");
    await dialog.waitFor({ state: "visible" });
    await press("Escape");
    await dialog.waitFor({ state: "hidden" });
    const theme = () => page.evaluate(() => document.documentElement.dataset["theme"]);
    assert.equal(await theme(), "dark");
    await press("u");
    await comesTo(theme, "light");
    assert.notEqual(await drawn(canvas), first);
    await context.close();
  });

  test("what is done between two drawings of the page counts", async () => {
    const context = await reader();
    const page = await open(context, made);
    await drawn(page.locator("canvas").first());
    // Clicks and keys of one script: the browser draws after its end.
    const act = (...steps: string[]) =>
      page.evaluate((steps) => {
        const key = (key: string) =>
          (document.activeElement ?? document.body).dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true }));
        for (const step of steps) {
          const [what, name] = step.split(": ");
          if (what === "key") key(name === "Space" ? " " : name!);
          else if (what === "close") document.querySelector("dialog")!.close();
          else document.querySelector<HTMLElement>(name!)!.click();
        }
      }, steps);
    const dialog = page.getByRole("dialog");

    await act("key: ?", "close", "key: u");
    await comesTo(() => page.evaluate(() => document.documentElement.dataset["theme"]), "light");
    await act("key: ?", "close", "key: ?");
    await dialog.waitFor({ state: "visible" });
    await act("close", "key: 2", "key: Space");
    await linkSays(page, "front", "a");
    await act("click: .stage canvas", "key: 1");
    await page.locator("#tab-look").focus();
    await act("key: ArrowRight", "key: ArrowRight");
    await linkSays(page, "tab", "plots");
    await act("key: n");
    await page.locator(".metrics thead button").first().waitFor();
    await act("click: .metrics th:nth-child(4) button", "click: .metrics th:nth-child(4) button");
    await linkSays(page, "descending", "true");
    await act("click: .methods li:nth-child(2) input", "click: .methods li:nth-child(3) input");
    await linkOnce(page, (link) => link.get("hidden")?.split("|").length === 2);
    await act("key: l", "key: e");
    await page.getByRole("separator").focus();
    await act("key: ArrowRight", "key: ArrowRight", "key: PageDown");
    await linkSays(page, "split", "0.34");
    await act("click: [title='Double the scale (>)']", "click: [title='Double the scale (>)']");
    await linkSays(page, "gain", "2");
    const pair = (link: URLSearchParams) => [link.get("a"), link.get("b")];
    const before = pair(new URL(page.url().replace("#", "?")).searchParams);
    await act("click: [title='Exchange A and B (x)']", "click: [title='Exchange A and B (x)']", "key: t");
    assert.deepEqual(pair(await linkOnce(page, (link) => link.get("tone") !== null)), before);
    await page.evaluate(() => {
      const writeText = async (text: string) => void (document.title = text);
      Object.defineProperty(navigator, "clipboard", { value: { writeText } });
    });
    await act("key: 3", "key: y");
    await comesTo(async () => (await page.title()).includes("mode=grid"), true);
    await context.close();
  });

  test("a link shows the same view again", async () => {
    const context = await reader();
    const page = await open(
      context,
      made,
      "scene=smoke&spp=16&mode=flip&b=bilateral_searched&show=error&gain=-1&zoom=3&x=0.4&y=0.6",
    );
    const seen = await drawn(page.locator(".stage canvas"));
    const again = await open(context, made, (await linkOnce(page, (link) => link.get("zoom") === "3")).toString());
    await comesTo(() => pixels(again.locator(".stage canvas")), seen);
    await context.close();
  });

  test("tiles of the grid zoom together", async () => {
    const context = await reader();
    const page = await open(context, made, "mode=grid");
    const [one, other] = [page.locator(".tile canvas").nth(1), page.locator(".tile canvas").nth(3)];
    const [before, beforeOther] = [await drawn(one), await drawn(other)];
    await one.hover();
    await page.mouse.wheel(0, -600);
    await drawn(one, before);
    await drawn(other, beforeOther);
    await context.close();
  });
});

describe("A minus B", () => {
  test("is what the values say, and turns round with A and B", async () => {
    const context = await reader();
    const page = await open(context, made, "a=noisy&b=reference&zoom=4");
    const canvas = page.locator(".stage canvas");
    const picture = await drawn(canvas);
    await page.keyboard.press("g");
    await linkSays(page, "show", "difference");
    const difference = await drawn(canvas, picture);
    const box = (await canvas.boundingBox())!;
    await page.mouse.move(box.x + box.width / 2 + 1, box.y + box.height / 2 + 1);
    const cells = page.locator(".probe tr.minus td");
    await comesTo(() => cells.count(), 7);
    const read = async () => (await cells.allTextContents()).map((c) => Number(c.replace("−", "-").replace("+", "")));
    await comesTo(async () => (await read()).every(Number.isFinite), true);
    const [r, g, b, luminance, , signed] = await read();
    assert.ok(Math.abs(0.2126 * r! + 0.7152 * g! + 0.0722 * b! - luminance!) < 0.01 && luminance !== 0);
    assert.equal(signed, luminance, "the scene's exposure is 1");
    await page.keyboard.press("x");
    await comesTo(async () => (await read())[3], -luminance!);
    assert.notEqual(await drawn(canvas), difference);
    await page.keyboard.press("g");
    await linkSays(page, "show", null);
    await context.close();
  });

  test("in the grid is A minus each: nothing is left at A itself", async () => {
    const context = await reader();
    const page = await open(context, made, "mode=grid&show=difference&error=luminance&a=noisy");
    const centre = (method: string) => middleOf(page.locator(".tile", { hasText: method }).locator("canvas"));
    for (const canvas of await page.locator(".tile canvas").all()) await drawn(canvas);
    const none = await centre("A − path tracing");
    assert.ok(Math.max(...none.slice(0, 3)) < 40, `black where nothing differs: ${none}`);
    assert.notDeepEqual(await centre("A − reference"), none);
    await context.close();
  });
});

judgeWhatPagesSaid();
