// What the page of `brume view` tells and keeps: problems, lost connections, progress, files. The program is made up (view_fake.ts).
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import test from "node:test";
import { comesTo, drawn, pixels, violations } from "./browser";
import type { Fake } from "./view_fake";
import {
  ADDRESS,
  context,
  drag,
  fake,
  frame,
  inBrowser,
  kept,
  last,
  looks,
  open,
  picture,
  says,
  shots,
} from "./view_page";

inBrowser(() => {
  test("says that the connection is lost, tries again, and sends its state when it is back", async () => {
    const made = await context();
    const page = await open(made);
    await drag(page, 60, 0);
    await comesTo(async () => (await last(page)).moving, false);
    const { set } = await last(page);
    await page.evaluate(() => (window as unknown as { fake: Fake }).fake.lose());
    await page.getByRole("alert").getByText("connection to the program is lost").waitFor();
    await drawn(picture(page));
    await page.evaluate(() => (window as unknown as { fake: Fake }).fake.comeBack());
    const count = (await looks(page)).length;
    await page.getByText("connection to the program is lost").waitFor({ state: "detached" });
    await comesTo(async () => (await looks(page)).length > count, true);
    assert.deepEqual((await last(page)).set, set);
    await made.close();
  });

  test("a problem is told and can be dismissed; the picture stays", async () => {
    const made = await context();
    const page = await open(made);
    await page.evaluate(() => (window as unknown as { fake: Fake }).fake.problem("line 3: no such\n  key"));
    const alert = page.getByRole("alert");
    await alert.getByText("line 3: no such").waitFor();
    await drawn(picture(page));
    assert.deepEqual(await violations(page, "problem"), []);
    await alert.getByRole("button", { name: "Dismiss the problem" }).click();
    await alert.getByText("line 3").waitFor({ state: "detached" });
    await made.close();
  });

  test("scene and picture can be kept; what is not there yet is told", async () => {
    const made = await context();
    await made.grantPermissions(["clipboard-read", "clipboard-write"]);
    const page = await open(made, {}, /404/);
    const download = async (name: string) => {
      const [file] = await Promise.all([page.waitForEvent("download"), page.getByRole("button", { name }).click()]);
      return { name: file.suggestedFilename(), bytes: readFileSync((await file.path())!) };
    };
    const scene = await download("Scene");
    assert.deepEqual([scene.name, scene.bytes.toString()], ["ball.toml", 'name = "ball"\n']);
    const png = await download("PNG");
    assert.equal(png.name, "ball.png");
    assert.deepEqual([png.bytes.readUInt32BE(16), png.bytes.readUInt32BE(20)], (await last(page)).size);
    // An EXR of a frame that is not there yet waits for it.
    await page.getByRole("button", { name: "EXR" }).click();
    await page.getByText("saved as soon as the whole picture is there").waitFor();
    const [exr] = await Promise.all([page.waitForEvent("download"), (frame.isThere = true)]);
    assert.equal(exr.suggestedFilename(), "ball.exr");
    frame.isThere = false;
    await page.keyboard.press("1");
    await page.locator("code", { hasText: "camera.position" }).waitFor();
    await page.getByRole("button", { name: "Copy the command line" }).click();
    await page.getByText("Command line copied").waitFor();
    const text = await page.evaluate(() => navigator.clipboard.readText());
    assert.match(text, /^brume render camera\.position=\[0,-6\.\d+,0\]/);
    await made.close();
  });

  test("what is kept is what is seen: the camera of the click, a coarse picture at the size asked for", async () => {
    const made = await context();
    const page = await open(made);
    const count = kept.length;
    await fake(page, (f) => (f.coarse = true));
    const before = await pixels(picture(page));
    await page.keyboard.press("ArrowRight");
    await drawn(picture(page), before);
    await comesTo(async () => (await last(page)).moving, false);
    await page.getByText("shown: predicted, coarse").waitFor();
    const download = async (name: string) => {
      const [file] = await Promise.all([page.waitForEvent("download"), page.getByRole("button", { name }).click()]);
      return readFileSync((await file.path())!);
    };
    await download("Scene");
    const { set, size } = await last(page);
    assert.match(set[0]!, /^camera\.position=/);
    assert.equal(kept.length, count + 1);
    assert.equal(kept.at(-1)!.name, "scene.toml");
    assert.deepEqual(kept.at(-1)!.state.set, set);
    assert.deepEqual(kept.at(-1)!.state.size, size);
    const png = await download("PNG");
    assert.deepEqual([png.readUInt32BE(16), png.readUInt32BE(20)], size);
    await page.getByText("the picture was still coarse").waitFor();
    // One whose view is left before its frame is there is not saved.
    await page.getByRole("button", { name: "EXR" }).click();
    await page.getByText("saved as soon as").waitFor();
    await page.keyboard.press("ArrowRight");
    await page.getByText("nothing was saved").waitFor();
    await made.close();
  });

  test("a problem ends with a later look, a lasting one when the scene was read again", async () => {
    const made = await context();
    const page = await open(made);
    const alert = page.getByRole("alert");
    const id = async () => ((await looks(page)).at(-1) as unknown as { id: number }).id;
    const problem = async (text: string, lasting: boolean) =>
      fake(page, (f, p) => f.tell(p!), { type: "problem", id: await id(), text, lasting });
    await problem("no such key", false);
    await alert.getByText("no such key").waitFor();
    await page.getByText("stopped by a problem").waitFor();
    await page.keyboard.press("ArrowRight");
    await alert.getByText("no such key").waitFor({ state: "detached" });
    await comesTo(async () => (await last(page)).moving, false);
    await problem("ball.toml: the file is gone", true);
    await alert.getByText("the file is gone").waitFor();
    await page.keyboard.press("ArrowRight");
    await comesTo(async () => (await last(page)).moving, false);
    await page.waitForTimeout(200);
    assert.equal(await alert.getByText("the file is gone").count(), 1);
    // The scene that was read again has the number of the look that failed.
    await fake(page, (f, p) => f.tell(p!), {
      type: "scene",
      id: await id(),
      name: "ball",
      layers: [{ name: "picture", channels: 3 }],
      groups: [],
      reloaded: true,
    });
    await alert.getByText("the file is gone").waitFor({ state: "detached" });
    await made.close();
  });

  test("a file without a usable grid offers those that it has", async () => {
    const made = await context();
    const page = await open(made);
    await fake(page, (f, p) => f.tell(p!), {
      type: "problem",
      id: 1e9,
      text: "ball.vdb: no grid 'density'",
      grid_key: "volumes.0.grid",
      grids: [
        { name: "soot", type: "float", usable: true },
        { name: "", type: "float", usable: true },
        { name: "vel", type: "vec3s", usable: false },
      ],
    });
    const alert = page.getByRole("alert");
    await alert.getByText("vel").waitFor();
    assert.deepEqual(await alert.locator(".grids button").allTextContents(), ["soot float", "(no name) float"]);
    assert.deepEqual(await violations(page, "grids"), []);
    await page.screenshot({ path: join(shots, "grids.png") });
    await alert.getByRole("button", { name: "soot" }).click();
    await says(page, ['volumes.0.grid="soot"']);
    await made.close();
  });

  test("the status line counts on between messages, with a bar and an estimate", async () => {
    const made = await context();
    const page = await open(made);
    const status = page.locator(".status");
    const progress = (share: number, samples: number) =>
      fake(page, (f, p) => f.tell(p!), { type: "progress", id: 1, stage: "sampling", samples, goal: 16, share, seconds: 9 });
    await progress(0.1, 9);
    await status.getByText("9 of 16 spp").waitFor();
    assert.ok(Math.abs(await page.locator(".status progress").evaluate((e) => (e as HTMLProgressElement).value)) > 0.09);
    const seconds = async () => parseFloat((await status.locator(".passed").textContent()) ?? "");
    const before = await seconds();
    await comesTo(async () => (await seconds()) > before + 0.9, true);
    assert.equal(await status.locator(".left").count(), 0);
    await progress(0.5, 12);
    await status.getByText("12 of 16 spp").waitFor();
    await comesTo(async () => /^\d[\d. a-z]* left$/.test((await status.locator(".left").textContent()) ?? ""), true);
    assert.deepEqual(await violations(page, "status"), []);
    await page.screenshot({ path: join(shots, "status.png") });
    await made.close();
  });

  test("a page whose turn another one has says so, and takes it back", async () => {
    const made = await context();
    const page = await open(made);
    await comesTo(() => page.locator(".stage-name").getAttribute("data-stage"), "done");
    const count = (await looks(page)).length;
    await fake(page, (f) => f.tell({ type: "progress", id: 1, stage: "elsewhere" }));
    await page.getByText("another page of this program is being computed").waitFor();
    await page.getByRole("button", { name: "Go on here" }).click();
    await comesTo(async () => (await looks(page)).length, count + 1);
    await comesTo(() => page.locator(".stage-name").getAttribute("data-stage"), "done");
    await made.close();
  });

  test("a page of a program that has ended says so and tries no more", async () => {
    const made = await context();
    const page = await open(made, {}, /404/);
    await page.route(ADDRESS, (route) => route.fulfill({ status: 404, contentType: "text/plain", body: "nothing is here" }));
    await fake(page, (f) => f.lose());
    await page.getByText("This page belongs to a program that has ended").waitFor();
    const tries = () => page.evaluate(() => (window as unknown as { fake: Fake }).fake.tries);
    const before = await tries();
    await page.waitForTimeout(2500);
    assert.equal(await tries(), before);
    await drawn(picture(page));
    assert.deepEqual(await violations(page, "ended"), []);
    await made.close();
  });
});
