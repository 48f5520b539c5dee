// The page of `brume view` in windows of every size, light and dark, and what axe finds there. The program is made up (view_fake.ts).
import assert from "node:assert/strict";
import { join } from "node:path";
import test from "node:test";
import { comesTo, violations } from "./browser";
import { box, context, DESKTOP, fake, field, inBrowser, middle, NARROW, open, picture, shots } from "./view_page";

inBrowser(() => {
  test("the page is light or dark as the system asks, also when that changes", async () => {
    const made = await context(DESKTOP, { colorScheme: "light" });
    const page = await open(made, { frames: [1, 2] });
    const ground = () => page.locator(".panels").evaluate((e) => getComputedStyle(e).backgroundColor);
    assert.equal(await ground(), "rgb(255, 255, 255)");
    await page.getByLabel("Layer", { exact: true }).selectOption("depth");
    await page.getByLabel("Compare with layer").selectOption("picture");
    await page.locator(".legend").waitFor();
    const { x, y } = await middle(picture(page));
    await page.mouse.move(x - 30, y);
    await fake(page, (f) => f.problem("line 3: no such key"));
    await page.getByRole("alert").getByText("line 3").waitFor();
    await page.keyboard.press("l");
    assert.deepEqual(await violations(page, "light"), []);
    await page.screenshot({ path: join(shots, "light.png") });
    await page.emulateMedia({ colorScheme: "dark" });
    await comesTo(ground, "rgb(23, 25, 28)");
    assert.deepEqual(await violations(page, "dark"), []);
    await made.close();
  });

  test("narrow windows keep the picture large", async () => {
    for (const [width, height] of [
      [800, 900],
      [390, 844],
    ] as const) {
      const made = await context({ width, height });
      const page = await open(made);
      const room = await box(picture(page));
      assert.equal(room.width, width);
      assert.ok(room.height >= 0.55 * height, `${room.height} of ${height}`);
      assert.equal(await page.evaluate(() => document.documentElement.scrollWidth), width);
      assert.deepEqual(await violations(page, `${width} columns`), []);
      await page.screenshot({ path: join(shots, `narrow_${width}.png`) });
      // The picture is seen while a panel below it is used.
      await field(page, "lights.0.irradiance").scrollIntoViewIfNeeded();
      assert.ok((await box(picture(page))).y >= 0);
      await page.screenshot({ path: join(shots, `narrow_${width}_panels.png`) });
      await made.close();
    }
  });

  test("fits a window of 320 pixels, and axe finds nothing anywhere", async () => {
    const made = await context(NARROW, { hasTouch: true, reducedMotion: "reduce" });
    const page = await open(made, { frames: [1, 2] });
    const wide = () => page.evaluate(() => document.documentElement.scrollWidth);
    assert.equal(await wide(), 320);
    assert.ok((await box(picture(page))).height > 300);
    for (const name of ["camera", "film"]) await page.locator(`[data-panel="${name}"] h2 button`).click();
    for (const more of await page.locator("button.more").all()) await more.click();
    assert.equal(await wide(), 320);
    assert.deepEqual(await violations(page, "narrow"), []);
    await page.screenshot({ path: join(shots, "narrow.png"), fullPage: true });
    await page.getByRole("button", { name: "Panels" }).click();
    assert.equal(await wide(), 320);
    await made.close();
    const large = await context();
    const desk = await open(large, { frames: [1, 2] });
    for (const name of ["camera", "film"]) await desk.locator(`[data-panel="${name}"] h2 button`).click();
    for (const more of await desk.locator("button.more").all()) await more.click();
    await desk.keyboard.press("l");
    assert.deepEqual(await violations(desk, "desktop"), []);
    await desk.screenshot({ path: join(shots, "desktop.png") });
    await large.close();
  });
});
