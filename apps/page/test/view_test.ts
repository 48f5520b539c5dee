// The page of `brume view` with a made-up program (view_fake.ts), where exact pictures and messages count.
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import test from "node:test";
import type { Locator } from "playwright-core";
import { comesTo, drawn, middleOf, pixels, violations } from "./browser";
import type { Fake } from "./view_fake";
import {
  ADDRESS,
  box,
  context,
  DESKTOP,
  drag,
  fake,
  field,
  frame,
  inBrowser,
  kept,
  last,
  looks,
  middle,
  NARROW,
  open,
  picture,
  says,
  shots,
  slide,
  vectorOf,
} from "./view_page";

inBrowser(() => {
  test("shows the picture as large as its room, and asks for that size", async () => {
    const made = await context({ width: 1800, height: 900 });
    const page = await open(made);
    const room = await box(picture(page));
    const { size, moving, set, layers } = await last(page);
    assert.deepEqual(size, [1280, Math.round((room.height * 1280) / room.width)]);
    assert.deepEqual({ moving, set, layers }, { moving: false, set: [], layers: ["picture"] });
    await page.getByRole("button", { name: "½", exact: true }).click();
    await comesTo(async () => (await last(page)).size, [room.width / 2, Math.round(room.height / 2)]);
    await page.keyboard.press("p");
    await comesTo(async () => (await last(page)).size[0], 900);
    assert.equal(await page.title(), "ball – brume");
    await made.close();
  });

  test("a drag sends a state for each frame, coarse until it ends, and is one step of undo", async () => {
    const made = await context();
    const page = await open(made);
    const before = await pixels(picture(page));
    const count = (await looks(page)).length;
    await drag(page, 160, 0);
    await comesTo(async () => (await last(page)).moving, false);
    const steps = (await looks(page)).slice(count);
    assert.ok(steps.length >= 2 && steps.length <= 12, `${steps.length} states`);
    assert.ok(steps.slice(0, -1).every(({ moving }) => moving));
    // To the right: the ball turns to the right, the camera to the left.
    const position = vectorOf((await last(page)).set, "camera.position");
    assert.ok(position[0]! < -1 && Math.abs(Math.hypot(...position) - Math.hypot(0, 6, 1)) < 1e-3, String(position));
    await drawn(picture(page), before);
    await page.keyboard.press("Control+z");
    await says(page, []);
    assert.ok(await page.getByRole("button", { name: "Undo" }).isDisabled());
    await page.getByRole("button", { name: "Redo" }).click();
    await comesTo(async () => vectorOf((await last(page)).set, "camera.position"), position);
    await page.getByRole("button", { name: "Reset all" }).click();
    await says(page, []);
    await made.close();
  });

  test("pans with shift and the right button, dollies with the wheel, zooms with control", async () => {
    const made = await context();
    const page = await open(made);
    for (const options of [{ key: "Shift" }, { button: "right" }] as const) {
      await drag(page, 100, 0, options);
      await comesTo(async () => (await last(page)).set.length, 2);
      const { set } = await last(page);
      assert.ok(vectorOf(set, "camera.look_at")[0]! < -0.1);
      assert.ok(Math.abs(vectorOf(set, "camera.look_at")[0]! - vectorOf(set, "camera.position")[0]!) < 1e-4);
      await page.keyboard.press("Control+z");
      await says(page, []);
    }
    await page.mouse.wheel(0, -200);
    await comesTo(async () => (await last(page)).set.length, 1);
    assert.ok(Math.hypot(...vectorOf((await last(page)).set, "camera.position")) < 5);
    await comesTo(async () => (await last(page)).moving, false);
    await page.keyboard.press("0");
    await says(page, []);
    await page.keyboard.down("Control");
    await page.mouse.wheel(0, -200);
    await page.keyboard.up("Control");
    await comesTo(async () => (await last(page)).set.map((s) => s.split("=")[0]), ["camera.fov"]);
    await made.close();
  });

  test("a double click looks at what is there; nothing is done where nothing is", async () => {
    const made = await context();
    const page = await open(made);
    const { x, y } = await middle(picture(page));
    await page.mouse.dblclick(x + 20, y);
    await says(page, ["camera.look_at=[0.1,-0.9,0.2]"]);
    const room = await box(picture(page));
    await page.mouse.dblclick(room.x + 8, room.y + 8);
    await page.getByText("There is nothing to look at").waitFor();
    await says(page, ["camera.look_at=[0.1,-0.9,0.2]"]);
    await made.close();
  });

  test("the sun follows a drag with its tool", async () => {
    const made = await context();
    const page = await open(made);
    const before = await pixels(picture(page));
    await page.keyboard.press("l");
    await drag(page, 150, 0);
    await comesTo(async () => (await last(page)).moving, false);
    const { set } = await last(page);
    assert.equal(set.length, 1);
    assert.ok(vectorOf(set, "lights.0.direction")[0]! > -0.5, String(set));
    await drawn(picture(page), before);
    await page.keyboard.press("Escape");
    await drag(page, 20, 0);
    await comesTo(async () => (await last(page)).set.some((s) => s.startsWith("camera.position")), true);
    await made.close();
  });

  test("a lamp is put where the picture is clicked, and taken away again", async () => {
    const made = await context();
    const page = await open(made);
    await page.getByRole("button", { name: "Add lamp" }).click();
    const { x, y } = await middle(picture(page));
    await page.mouse.click(x, y);
    await comesTo(async () => (await last(page)).set.length, 1);
    const lamp = (await last(page)).set[0]!;
    assert.match(lamp, /^lights\.1=\{type="sphere",position=\[[^\]]*\],radius=0\.0692\d*,radiance=\[676\.\d+,/);
    const panel = page.locator('[data-panel="lights.1"]');
    await panel.waitFor();
    await panel.getByRole("switch").click();
    await says(page, [lamp, "lights.1.enabled=false"]);
    await page.screenshot({ path: join(shots, "lamp.png") });
    await panel.getByRole("button", { name: /Take sphere away/ }).click();
    await says(page, []);
    await made.close();
  });

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

  test("all can be done with the keyboard alone", async () => {
    const made = await context();
    const page = await open(made);
    const reach = async (target: Locator) => {
      for (let i = 0; i < 120; ++i) {
        if (await target.evaluate((e) => e === document.activeElement)) return;
        await page.keyboard.press("Tab");
      }
      assert.fail(`${String(target)} is not reached`);
    };
    await reach(picture(page));
    await comesTo(async () => /luminance/.test((await page.locator(".value").textContent()) ?? ""), true);
    await page.keyboard.press("ArrowRight");
    await comesTo(async () => vectorOf((await last(page)).set, "camera.position")[0]! > 0.3, true);
    await comesTo(async () => (await last(page)).moving, false);
    await page.keyboard.press("Shift+ArrowUp");
    await comesTo(async () => (await last(page)).set.length, 2);
    await page.keyboard.press("+");
    await page.keyboard.press("Home");
    await says(page, []);
    await page.keyboard.press("a");
    await page.keyboard.press("Enter");
    await comesTo(async () => (await last(page)).set[0]?.startsWith("lights.1="), true);
    await page.keyboard.press("Control+z");
    await says(page, []);
    const slider = field(page, "volumes.0.g").getByRole("slider");
    await reach(slider);
    await page.keyboard.press("ArrowRight");
    await comesTo(async () => /^volumes\.0\.g=0\.6[12]/.test((await last(page)).set[0] ?? ""), true);
    const camera = page.locator('[data-panel="camera"] h2 button');
    await camera.focus();
    assert.equal(await camera.getAttribute("aria-expanded"), "false");
    await page.keyboard.press("Enter");
    await comesTo(() => camera.getAttribute("aria-expanded"), "true");
    await field(page, "camera.fov").locator("input.number").focus();
    await page.keyboard.press("ArrowUp");
    await comesTo(async () => (await last(page)).set.some((s) => s.startsWith("camera.fov=3")), true);
    await page.keyboard.press("Tab");
    await camera.focus();
    await page.keyboard.press("?");
    await page.locator("dialog[open]").waitFor();
    assert.deepEqual(await violations(page, "help"), []);
    await page.keyboard.press("Escape");
    await page
      .locator("dialog[open]")
      .waitFor({ state: "detached" })
      .catch(() => {});
    await made.close();
  });

  test("fingers turn, and two of them move and pinch", async () => {
    const made = await context(DESKTOP, { hasTouch: true });
    const page = await open(made);
    const { x, y } = await middle(picture(page));
    const session = await made.newCDPSession(page);
    const touch = (type: "touchStart" | "touchMove" | "touchEnd", points: [number, number][]) =>
      session.send("Input.dispatchTouchEvent", {
        type,
        touchPoints: points.map(([px, py], id) => ({ x: px, y: py, id })),
      });
    await touch("touchStart", [[x, y]]);
    for (let i = 1; i <= 5; ++i) await touch("touchMove", [[x + 20 * i, y]]);
    await touch("touchEnd", []);
    await comesTo(async () => (await last(page)).set.map((s) => s.split("=")[0]), ["camera.position"]);
    await page.keyboard.press("0");
    await says(page, []);
    await touch("touchStart", [
      [x - 40, y],
      [x + 40, y],
    ]);
    for (let i = 1; i <= 5; ++i)
      await touch("touchMove", [
        [x - 40 - 16 * i, y],
        [x + 40 + 16 * i, y],
      ]);
    await touch("touchEnd", []);
    await comesTo(async () => (await last(page)).moving, false);
    // Three times as far apart: three times closer.
    const position = vectorOf((await last(page)).set, "camera.position");
    assert.ok(Math.abs(Math.hypot(...position) - Math.hypot(0, 6, 1) / 3) < 0.3, String(position));
    await made.close();
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
