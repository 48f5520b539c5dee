// The panels of the page of `brume view`: fields and sliders. The program is made up (view_fake.ts).
import assert from "node:assert/strict";
import { join } from "node:path";
import test from "node:test";
import { comesTo } from "./browser";
import { box, context, field, inBrowser, last, open, says, shots, slide } from "./view_page";

inBrowser(() => {
  test("every kind of field can be set and reset", async () => {
    const made = await context();
    const page = await open(made);
    await slide(field(page, "volumes.0.sigma_t").getByRole("slider"), 0);
    await says(page, ["volumes.0.sigma_t=0"]);
    await page.getByRole("button", { name: "Reset ball.vdb extinction" }).click();
    await says(page, []);
    await field(page, "volumes.0.albedo").locator("input[type=color]").fill("#00ff00");
    await says(page, ["volumes.0.albedo=[0,0.9,0]"]);
    await field(page, "volumes.0.albedo").locator("input.number").fill("0.5");
    await page.keyboard.press("Enter");
    await says(page, ["volumes.0.albedo=[0,0.5,0]"]);
    // Nothing outside of what the scene allows, and nothing that is no number.
    const g = field(page, "volumes.0.g").locator("input.number");
    await g.fill("7");
    await g.blur();
    await says(page, ["volumes.0.albedo=[0,0.5,0]", "volumes.0.g=0.999"]);
    await g.fill("much");
    await g.blur();
    assert.equal(await g.inputValue(), "0.999");
    await field(page, "lights.0.direction").locator("input").nth(1).fill("0,5");
    await page.keyboard.press("Enter");
    await field(page, "environment.sky").locator("select").selectOption("preetham");
    await field(page, "environment.turbidity").locator("input.number").fill("5");
    await page.keyboard.press("Enter");
    await page.getByRole("button", { name: "more of ball.vdb" }).click();
    await field(page, "volumes.0.flame_ramp").locator("input").fill("0, 1, 1, 1");
    await page.keyboard.press("Enter");
    await page.getByRole("switch", { name: "sun enabled" }).click();
    await says(page, [
      "volumes.0.albedo=[0,0.5,0]",
      "volumes.0.g=0.999",
      "lights.0.direction=[-0.8,0.5,0.55]",
      'environment.sky="preetham"',
      "environment.turbidity=5",
      "volumes.0.flame_ramp=[0,1,1,1]",
      "lights.0.enabled=false",
    ]);
    assert.equal(await field(page, "volumes.0.file").locator("input, select").count(), 0);
    await page.screenshot({ path: join(shots, "fields.png") });
    await made.close();
  });

  test("sliders begin where values are useful; shift, wheel and arrows step them finely", async () => {
    const made = await context();
    const page = await open(made);
    const value = async () => Number((await last(page)).set[0]?.split("=")[1] ?? 40);
    const slider = field(page, "volumes.0.sigma_t").getByRole("slider");
    await slider.scrollIntoViewIfNeeded();
    const { x, y, width, height } = await box(slider);
    const press = async (key: string, times: number) => {
      for (let i = 0; i < times; ++i) await page.keyboard.press(key);
    };
    // The whole way is no more than four hundred times, with the file's value in the middle of it.
    await page.mouse.click(x + width - 10, y + height / 2);
    await comesTo(async () => (await value()) > 600 && (await value()) < 900, true);
    await page.mouse.click(x + width / 2, y + height / 2);
    await comesTo(async () => Math.abs((await value()) / 40 - 1) < 0.2, true);
    // With Shift the same way is a tenth.
    const drags = async (shift: boolean) => {
      await page.mouse.move(x + width / 2, y + height / 2);
      if (shift) await page.keyboard.down("Shift");
      await page.mouse.down();
      await page.mouse.move(x + width / 2 + 12, y + height / 2, { steps: 3 });
      await page.mouse.up();
      if (shift) await page.keyboard.up("Shift");
      await comesTo(async () => (await last(page)).moving, false);
    };
    const before = await value();
    await drags(true);
    await comesTo(async () => (await value()) > before, true);
    const fine = Math.log((await value()) / before);
    await page.mouse.click(x + width / 2, y + height / 2);
    await comesTo(value, before);
    await drags(false);
    const coarse = Math.log((await value()) / before);
    assert.ok(coarse / fine > 6 && coarse / fine < 16, `${coarse} and ${fine}`);
    // Arrow keys and the wheel.
    await slider.focus();
    let now = await value();
    await press("ArrowRight", 1);
    await comesTo(async () => (await value()) > now * 1.01, true);
    now = await value();
    await press("Shift+ArrowRight", 1);
    await comesTo(async () => (await value()) > now && (await value()) < now * 1.02, true);
    now = await value();
    await page.mouse.move(x + width / 2, y + height / 2);
    await page.mouse.wheel(0, -100);
    await comesTo(async () => (await value()) > now * 1.01, true);
    // A value that is typed beyond the slider is taken, and the slider reaches it.
    const typed = field(page, "volumes.0.sigma_t").locator("input.number");
    await typed.fill("12345");
    await page.keyboard.press("Enter");
    await says(page, ["volumes.0.sigma_t=12345"]);
    await comesTo(async () => Number(await slider.inputValue()) < 10000, true);
    await made.close();
  });

  test("fields are named in words, their keys stand in the tooltips", async () => {
    const made = await context();
    const page = await open(made);
    for (const name of ["camera", "film"]) await page.locator(`[data-panel="${name}"] h2 button`).click();
    for (const more of await page.locator("button.more").all()) await more.click();
    const names = await page.locator(".field[data-key] .name").evaluateAll((all) =>
      all.map((e) => ({ text: e.firstChild!.textContent ?? "", key: e.closest("[data-key]")!.getAttribute("data-key")!, title: e.getAttribute("title") })),
    );
    assert.ok(names.length > 20);
    for (const { text, key, title } of names) {
      assert.ok(!/_/.test(text) && text.length > 1, `${key} is called ${text}`);
      assert.ok(title?.startsWith(`${key}:`), `${key}: ${title}`);
    }
    assert.ok(names.some(({ text, key }) => key === "volumes.0.sigma_t" && text === "extinction"));
    await made.close();
  });
});
