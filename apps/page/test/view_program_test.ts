// The page of `brume view` with the program itself.
import assert from "node:assert/strict";
import { copyFileSync, mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import test, { after, before } from "node:test";
import type { BrowserContext, Page } from "playwright-core";
import { comesTo, drawn, pixels, violations } from "./browser";
import { context, data, drag, field, folder, inBrowser, listen, middle, picture, Program, shots, slide, SMALL } from "./view_page";

inBrowser(() => {
  const cloud = new Program([join(data, "volumes", "cloud.vdb")]);
  let made: BrowserContext;
  let page: Page;

  const command = () => page.locator(".command code").textContent();
  const commandHas = (what: RegExp) => comesTo(async () => what.test((await command()) ?? ""), true, String(what));
  /** The quickest pictures: half a pixel for each of a small window. */
  const coarse = async () => page.getByRole("button", { name: "½", exact: true }).click();

  before(async () => {
    await cloud.start();
    made = await context(SMALL);
    page = await made.newPage();
    listen(page, /WebSocket connection|404|ERR_EMPTY_RESPONSE/); // its program ends and comes back
    await page.goto(cloud.address);
    await coarse();
  });
  after(async () => {
    await made.close();
    await cloud.end();
  });

  test("shows the volume, its fields and what the program assumed", async () => {
    await drawn(picture(page));
    await page.locator('[data-panel="volumes.0"]').getByText("cloud.vdb", { exact: true }).waitFor();
    await page.locator('[data-panel="volumes.0"] .depth').waitFor();
    await page.locator('[data-panel="notes"]').getByText("assumed").first().waitFor();
    await page.getByText("path traced, cleaned").waitFor();
    await page.screenshot({ path: join(shots, "cloud.png") });
    assert.deepEqual(await violations(page, "cloud"), []);
  });

  test("a drag, a slider and the sun change the picture and the command line", async () => {
    let before = await pixels(picture(page));
    await drag(page, 80, 30);
    before = await drawn(picture(page), before);
    await commandHas(/camera\.position=\[/);
    await slide(field(page, "volumes.0.sigma_t").getByRole("slider"), 3000);
    await drawn(picture(page), before);
    await commandHas(/volumes\.0\.sigma_t=/);
    before = await pixels(picture(page));
    await page.keyboard.press("l");
    await drag(page, -120, 40);
    await page.keyboard.press("Escape");
    await drawn(picture(page), before);
    await commandHas(/lights\.\d\.direction=|environment\.sun_direction=/);
  });

  test("a lamp is accepted", async () => {
    await page.keyboard.press("a");
    const { x, y } = await middle(picture(page));
    await page.mouse.click(x, y);
    await commandHas(/lights\.\d+=\{type="sphere"/);
    await page.keyboard.press("Control+z");
    await comesTo(async () => /sphere/.test((await command()) ?? ""), false);
    assert.equal(await page.locator(".alert.problem").count(), 0);
  });

  test("layers are switched and compared", async () => {
    await page.getByLabel("Layer", { exact: true }).selectOption("clean_error");
    await page.locator(".legend").getByText("estimated error").waitFor();
    const before = await pixels(picture(page));
    await page.getByLabel("Compare with layer").selectOption("noisy");
    await drawn(picture(page), before);
    await page.getByLabel("Layer", { exact: true }).selectOption("picture");
    await page.getByLabel("Compare with layer").selectOption("");
    await page.locator(".legend").waitFor({ state: "detached" });
  });

  test("scene and frame can be kept", async () => {
    await page.getByText("path traced, cleaned").waitFor();
    const save = async (name: string) => {
      const [file] = await Promise.all([page.waitForEvent("download"), page.getByRole("button", { name }).click()]);
      return readFileSync((await file.path())!);
    };
    const scene = (await save("Scene")).toString();
    assert.match(scene, /sigma_t/);
    assert.match(scene, /\[camera\]/);
    const exr = await save("EXR");
    assert.equal(exr.readUInt32LE(0), 20000630);
  });

  test("a reload keeps the state", async () => {
    const before = await command();
    await page.reload();
    await drawn(picture(page));
    await comesTo(command, before);
  });

  test("a program that ends and is there again is found", async () => {
    const before = await command();
    await cloud.kill();
    await page.getByText("connection to the program is lost").waitFor();
    await cloud.start();
    await page.getByText("connection to the program is lost").waitFor({ state: "detached" });
    const shown = await pixels(picture(page));
    await drag(page, 60, 0);
    await drawn(picture(page), shown);
    await comesTo(async () => (await command()) !== before, true);
    await commandHas(/volumes\.0\.sigma_t=/);
  });

  test("the time line of a sequence shows its frames", async () => {
    const files = join(folder, "sequence");
    mkdirSync(files, { recursive: true });
    for (const [i, name] of ["cloud", "fire", "cloud"].entries())
      copyFileSync(join(data, "volumes", `${name}.vdb`), join(files, `shot.000${i + 1}.vdb`));
    writeFileSync(
      join(files, "shot.toml"),
      `[camera]
position = [1, -7, 1]
look_at = [1, 0, 1]
[environment]
radiance = 0.3
[[volumes]]
file = "shot.####.vdb"
sigma_t = 10
[[lights]]
type = "sun"
direction = [-1, -1, 1]
irradiance = 3
`,
    );
    const sequence = new Program([join(files, "shot.toml"), "--frames", "1-3"]);
    await sequence.start();
    try {
      page = await made.newPage();
      listen(page, /404/);
      await page.goto(sequence.address);
      await coarse();
      const first = await drawn(picture(page));
      await page.getByLabel("Frame number").fill("2");
      await page.keyboard.press("Enter");
      await drawn(picture(page), first);
      await comesTo(() => page.getByLabel("Frame number").inputValue(), "2");
      await page.getByRole("button", { name: "Play" }).click();
      const seen = new Set<string>();
      await comesTo(async () => seen.add(await page.getByLabel("Frame number").inputValue()).size, 3);
      await page.getByRole("button", { name: "Pause" }).click();
      assert.equal(await page.locator(".alert.problem").count(), 0);
    } finally {
      await page.close();
      await sequence.end();
    }
  });
});
