// Frames that are there in the page of `brume view`: layers and mattes, lights mixed without rendering, what is kept.
import assert from "node:assert/strict";
import { spawnSync } from "node:child_process";
import { mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import test from "node:test";
import { comesTo, drawn, middleOf, pixels, violations } from "./browser";
import { brume, context, data, DESKTOP, field, folder, inBrowser, listen, picture, Program, shots, slide } from "./view_page";

inBrowser(() => {
  test("layers of a frame are chosen, and its lights mixed; nothing is there that only scenes have", async () => {
    const files = join(folder, "frames");
    mkdirSync(files, { recursive: true });
    const [scene, frame] = [join(files, "plume.toml"), join(files, "plume.exr")];
    writeFileSync(
      scene,
      `[camera]
position = [0, -6, 1.2]
look_at = [0.3, 0, 1]
[film]
width = 160
height = 120
[environment]
radiance = 0.3
[[volumes]]
file = "${join(data, "volumes", "smoke.vdb")}"
name = "Smoke"
sigma_t = 12
[[lights]]
type = "sun"
direction = [-1, -0.5, 0.6]
irradiance = [3, 1, 1]
group = "key"
`,
    );
    const rendered = spawnSync(brume, ["render", scene, "--clean", "--spp", "1", "-q", "--layers", "depths,cryptomatte", "-o", frame]);
    assert.equal(rendered.status, 0, rendered.stderr.toString());
    const program = new Program([frame]);
    await program.start();
    try {
      const made = await context(DESKTOP);
      const page = await made.newPage();
      listen(page);
      await page.goto(program.address);
      await page.getByText("160 × 120").waitFor();
      const before = await drawn(picture(page));
      assert.equal(await page.locator('[data-panel="camera"]').count(), 0);
      assert.ok(await page.getByRole("button", { name: "Sun" }).isHidden());
      assert.ok(await page.getByRole("button", { name: "Into the scene" }).isHidden());
      const slider = (group: string) => field(page, `mix.${group}`).getByRole("slider");
      await slide(slider("rest"), 0);
      const dark = await drawn(picture(page), before);
      const [red, green] = await middleOf(picture(page));
      assert.ok(red! > 2 * green!, `the sun's light alone is red: ${red}, ${green}`);
      await comesTo(
        async () => await page.locator(".command code").textContent(),
        `brume mix ${frame} --gain rest=0 -o plume_mix.exr`,
      );
      await page.screenshot({ path: join(shots, "frame.png") });
      assert.deepEqual(await violations(page, "frame"), []);
      const download = async (name: string) => {
        const [file] = await Promise.all([page.waitForEvent("download"), page.getByRole("button", { name, exact: true }).click()]);
        return [file.suggestedFilename(), await file.path()] as const;
      };
      const [mixName, mix] = await download("Mix");
      assert.equal(mixName, "plume_mix.toml");
      assert.match(readFileSync(mix, "utf8"), /\[mix\]\nrest = \[0\.0, 0\.0, 0\.0\]/);
      const [, exr] = await download("EXR");
      const mixed = join(files, "mixed.exr");
      assert.equal(spawnSync(brume, ["mix", frame, "--mix", mix, "-o", mixed]).status, 0);
      assert.equal(spawnSync(brume, ["compare", exr, mixed, "--max", "mse=0"]).status, 0);
      await slide(slider("key"), 0);
      await drawn(picture(page), dark);
      await comesTo(async () => (await middleOf(picture(page))).slice(0, 3), [0, 0, 0]);
      const layer = page.getByLabel("Layer", { exact: true });
      const names = await layer.locator("option").allTextContents();
      for (const wanted of ["noisy [W/(m² sr)]", "key [W/(m² sr)]", "key, noisy [W/(m² sr)]", "depth_mean", "Smoke", "alpha"])
        assert.ok(names.includes(wanted), `${wanted} of ${names.join()}`);
      await layer.selectOption({ label: "clean_direct" });
      await page.getByText("clean_direct: lights as rendered, not mixed").waitFor();
      await layer.selectOption({ label: "Smoke" });
      await page.getByLabel("Compare with layer").selectOption({ label: "depth_mean" });
      await page.locator('.legend[data-layer="depth_mean"]').waitFor();
      await page.screenshot({ path: join(shots, "frame_layers.png") });
      await page.keyboard.press("Control+z");
      await page.keyboard.press("Control+z");
      await page.getByLabel("Compare with layer").selectOption("");
      await layer.selectOption("picture");
      await comesTo(() => pixels(picture(page)), before);
      assert.equal(await page.locator(".alert.problem").count(), 0);
      // Cut short while it is looked at, and whole again.
      const whole = readFileSync(frame);
      writeFileSync(frame, whole.subarray(0, whole.length / 2));
      await page.getByText("truncated or damaged").waitFor();
      writeFileSync(frame, whole);
      await page.locator(".alert.problem").waitFor({ state: "detached" });
      await made.close();
    } finally {
      await program.end();
    }
  });
});
