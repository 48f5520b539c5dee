// Light groups mixed in the page of `brume view`: the picture follows a slider without a scene that is rendered again, and
// the mix goes into the scene.
import assert from "node:assert/strict";
import { mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import test from "node:test";
import type { Page } from "playwright-core";
import { comesTo, drawn, middleOf, pixels, violations } from "./browser";
import {
  context,
  data,
  fake,
  field,
  folder,
  inBrowser,
  kept,
  last,
  listen,
  looks,
  open,
  picture,
  Program,
  says,
  shots,
  slide,
  SMALL,
} from "./view_page";

const slider = (page: Page, group: string) => field(page, `mix.${group}`).getByRole("slider");
const mixIs = (page: Page, mix: Record<string, number[]> | undefined) => comesTo(async () => (await last(page)).mix, mix);

inBrowser(() => {
  test("a slider changes the picture and nothing of the scene; undo, double click and reset take it back", async () => {
    const made = await context();
    const page = await open(made, { mixes: true });
    const before = await pixels(picture(page));
    const count = (await looks(page)).length;
    await slide(slider(page, "key"), 0);
    await mixIs(page, { key: [0, 0, 0] });
    const dark = await drawn(picture(page), before);
    assert.ok((await looks(page)).slice(count).every(({ moving, set }) => !moving && !set.length));
    await slide(slider(page, "sky"), 5000);
    await mixIs(page, { key: [0, 0, 0], sky: [2, 2, 2] });
    await field(page, "mix.sky").locator("input[type=color]").fill("#ff0000");
    await mixIs(page, { key: [0, 0, 0], sky: [2, 0, 0] });
    await comesTo(async () => (await middleOf(picture(page))).slice(1), [0, 0, 255]);
    await page.screenshot({ path: join(shots, "mix.png") });
    assert.deepEqual(await violations(page, "mix"), []);
    await page.keyboard.press("Control+z");
    await page.keyboard.press("Control+z");
    await mixIs(page, { key: [0, 0, 0] });
    await comesTo(() => pixels(picture(page)), dark);
    await slider(page, "key").dblclick();
    await mixIs(page, undefined);
    await comesTo(() => pixels(picture(page)), before);
    await slide(slider(page, "key"), 10000);
    await mixIs(page, { key: [4, 4, 4] });
    await field(page, "mix.key").locator("input.number").fill("7.5");
    await page.keyboard.press("Enter");
    await mixIs(page, { key: [7.5, 7.5, 7.5] });
    await page.locator('[data-panel="mix"]').getByRole("button", { name: "Reset", exact: true }).click();
    await mixIs(page, undefined);
    await says(page, []);
    await made.close();
  });

  test("a mix that is not answered waits a while for its picture, and the last one comes", async () => {
    const made = await context();
    const page = await open(made, { mixes: true });
    await fake(page, (f) => (f.without = ["picture"]));
    for (const value of [1000, 2000, 3000, 10000]) await slide(slider(page, "key"), value);
    await mixIs(page, { key: [4, 4, 4] });
    await fake(page, (f) => (f.without = []));
    await slide(slider(page, "key"), 0);
    await mixIs(page, { key: [0, 0, 0] });
    await made.close();
  });

  test("the mix goes into the scene, as one step; layers that are not known by group say so", async () => {
    const made = await context();
    await made.grantPermissions(["clipboard-read", "clipboard-write"]);
    const page = await open(made, { mixes: true });
    const button = (name: string) => page.locator('[data-panel="mix"]').getByRole("button", { name });
    assert.ok(await button("Into the scene").isDisabled());
    await slide(slider(page, "key"), 1250);
    await mixIs(page, { key: [0.5, 0.5, 0.5] });
    await button("Copy TOML").click();
    await page.getByText("Scene copied as TOML").waitFor();
    assert.equal(await page.evaluate(() => navigator.clipboard.readText()), 'name = "ball"\n');
    assert.deepEqual(kept.filter(({ name }) => name === "scene.toml").at(-1)!.state.mix, { key: [0.5, 0.5, 0.5] });
    await page.getByLabel("Layer", { exact: true }).selectOption("noisy");
    await page.getByText("noisy: lights as rendered, not mixed").waitFor();
    await page.getByLabel("Layer", { exact: true }).selectOption("picture");
    await button("Into the scene").click();
    await says(page, ["lights.0.irradiance=[1.7,1.5,1.2]"]);
    assert.equal((await last(page)).mix, undefined);
    await page.keyboard.press("Control+z");
    await mixIs(page, { key: [0.5, 0.5, 0.5] });
    await says(page, []);
    await made.close();
  });

  test("groups that a scene has no longer are not asked for, and scenes without any have no panel", async () => {
    const made = await context();
    const page = await open(made, { mixes: true });
    await slide(slider(page, "key"), 0);
    await mixIs(page, { key: [0, 0, 0] });
    await fake(page, (f) => (f.ungrouped = true));
    await page.keyboard.press("1");
    await mixIs(page, undefined);
    await page.locator('[data-panel="mix"]').waitFor({ state: "detached" });
    await made.close();
  });

  test("with the program the picture is mixed while samples go on, and the mix is in the scene that is saved", async () => {
    const files = join(folder, "mix");
    mkdirSync(files, { recursive: true });
    const scene = join(files, "groups.toml");
    writeFileSync(
      scene,
      `[camera]
position = [0, -6, 1.2]
look_at = [0.3, 0, 1]
[environment]
radiance = 0.3
[[volumes]]
file = "${join(data, "volumes", "smoke.vdb")}"
sigma_t = 12
[[lights]]
type = "sun"
direction = [-1, -0.5, 0.6]
irradiance = 3
group = "key"
`,
    );
    const program = new Program([scene]);
    await program.start();
    try {
      const made = await context(SMALL);
      const page = await made.newPage();
      listen(page);
      await page.goto(program.address);
      await page.getByRole("button", { name: "½", exact: true }).click();
      await page.getByText("path traced, cleaned").waitFor();
      const before = await pixels(picture(page));
      const reads = () => page.locator(".stage-name").getAttribute("data-stage");
      await slide(slider(page, "key"), 0);
      const dark = await drawn(picture(page), before);
      assert.ok(["sampling", "cleaning", "done"].includes((await reads()) ?? ""), "nothing is solved for it");
      await slide(slider(page, "rest"), 0);
      await drawn(picture(page), dark);
      await comesTo(async () => (await middleOf(picture(page))).slice(0, 3), [0, 0, 0]);
      await slide(slider(page, "rest"), 5000);
      await comesTo(async () => (await middleOf(picture(page)))[0]! > 30, true);
      await page.screenshot({ path: join(shots, "mixed_program.png") });
      const [file] = await Promise.all([
        page.waitForEvent("download"),
        page.getByRole("button", { name: "Scene", exact: true }).click(),
      ]);
      const text = readFileSync((await file.path())!, "utf8");
      assert.match(text, /irradiance = \[0(\.0)?, 0(\.0)?, 0(\.0)?\]/);
      assert.match(text, /radiance = \[0\.6, 0\.6, 0\.6\]/);
      await comesTo(async () => /lights\.0\.irradiance=/.test((await page.locator(".command code").textContent()) ?? ""), true);
      await page.getByRole("button", { name: "Into the scene" }).click();
      await comesTo(async () => await slider(page, "rest").getAttribute("aria-valuetext"), "1");
      assert.equal(await page.locator(".alert.problem").count(), 0);
      await made.close();
    } finally {
      await program.end();
    }
  });
});
