// What the page of `brume view` shows: layers, exposure, sequences. The program is made up (view_fake.ts), so that pictures are exact.
import assert from "node:assert/strict";
import { join } from "node:path";
import test from "node:test";
import { comesTo, drawn, middleOf, pixels, violations } from "./browser";
import { context, fake, inBrowser, last, looks, middle, open, picture, says, shots, slide } from "./view_page";

inBrowser(() => {
  test("two layers stand at both sides of the divider, with values, false colours and a legend", async () => {
    const made = await context();
    const page = await open(made);
    await page.getByLabel("Layer", { exact: true }).selectOption("depth");
    await page.getByLabel("Compare with layer").selectOption("picture");
    await comesTo(async () => (await last(page)).layers, ["depth", "picture"]);
    await page.locator('.legend[data-layer="depth"]').waitFor();
    const { x, y } = await middle(picture(page));
    await page.mouse.move(x - 30, y);
    await comesTo(async () => /depth 5\.\d/.test((await page.locator(".value").textContent()) ?? ""), true);
    await page.mouse.move(x + 30, y);
    await comesTo(async () => /R .*luminance/.test((await page.locator(".value").textContent()) ?? ""), true);
    const divider = page.getByRole("separator");
    await page.mouse.move(x, y);
    await page.mouse.down();
    await page.mouse.move(x + 100, y, { steps: 4 });
    await page.mouse.up();
    await comesTo(async () => Number(await divider.getAttribute("aria-valuenow")) > 55, true);
    await divider.focus();
    await page.keyboard.press("Home");
    await comesTo(() => divider.getAttribute("aria-valuenow"), "0");
    await page.keyboard.press("End");
    await says(page, []);
    await page.screenshot({ path: join(shots, "layers.png") });
    assert.deepEqual(await violations(page, "layers"), []);
    await made.close();
  });

  test("exposure and tone curve change the display alone", async () => {
    const made = await context();
    const page = await open(made);
    const count = (await looks(page)).length;
    let before = await pixels(picture(page));
    await page.keyboard.press("]");
    before = await drawn(picture(page), before);
    await page.getByLabel("Tone curve").selectOption("log");
    before = await drawn(picture(page), before);
    await page.keyboard.press("\\");
    await drawn(picture(page), before);
    assert.equal((await looks(page)).length, count);
    await made.close();
  });

  test("a sequence plays from frame to frame and shows those it has had without asking", async () => {
    const made = await context();
    const page = await open(made, { frames: [1, 3, 5, 7] });
    const number = page.getByLabel("Frame number");
    await page.keyboard.press(".");
    await comesTo(async () => [(await last(page)).frame, await number.inputValue()], [3, "3"]);
    await page.keyboard.press(",");
    await page.keyboard.press(" ");
    await page.getByRole("button", { name: "Pause" }).waitFor();
    const asked = async () => (await looks(page)).filter(({ frame, moving }) => frame !== null && moving);
    await comesTo(async () => (await asked()).length >= 2, true);
    await page.waitForTimeout(600);
    const count = (await asked()).length;
    // Two of the four were seen before.
    assert.ok(count <= 3, `${count} states for two frames`);
    const seen = new Set<string>();
    for (let i = 0; i < 60 && seen.size < 4; ++i) {
      seen.add(await number.inputValue());
      await page.waitForTimeout(17);
    }
    assert.equal(seen.size, 4);
    await page.keyboard.press(" ");
    await comesTo(async () => (await last(page)).moving, false);
    await number.fill("6");
    await page.keyboard.press("Enter");
    await comesTo(async () => [5, 7].includes((await last(page)).frame!), true);
    await slide(page.getByRole("slider", { name: "Frame" }), 0);
    await comesTo(async () => (await last(page)).frame, 1);
    await page.screenshot({ path: join(shots, "sequence.png") });
    await made.close();
  });

  test("a layer that is not there yet is not shown under another's picture", async () => {
    const made = await context();
    const page = await open(made);
    await fake(page, (f) => {
      f.coarse = true;
      f.without = ["noisy"];
    });
    await page.getByLabel("Layer", { exact: true }).selectOption("noisy");
    await page.keyboard.press("ArrowRight");
    await comesTo(async () => (await last(page)).moving, false);
    await page.getByText("noisy: not there yet").waitFor();
    await comesTo(async () => (await middleOf(picture(page)))[3], 0);
    await page.getByRole("button", { name: "PNG" }).click();
    await page.getByText("There is no layer “noisy” yet").waitFor();
    // Something moves: the picture stands in, under its own name.
    const { x, y } = await middle(picture(page));
    await page.mouse.move(x, y);
    await page.mouse.down();
    await page.mouse.move(x + 40, y, { steps: 4 });
    await page.getByText("picture; noisy is not there yet").waitFor();
    await page.screenshot({ path: join(shots, "missing.png") });
    await page.mouse.up();
    await made.close();
  });

  test("layers are listed in groups, with their units", async () => {
    const made = await context();
    const page = await open(made);
    const list = page.getByLabel("Layer", { exact: true });
    assert.deepEqual(
      await list.locator("optgroup").evaluateAll((all) => all.map((e) => (e as HTMLOptGroupElement).label)),
      ["path traced", "shape of the media"],
    );
    await list.selectOption("depth");
    await page.locator(".legend").getByText("depth [scene units]").waitFor();
    assert.match((await list.locator("option:checked").textContent()) ?? "", /scene units/);
    await made.close();
  });
});
