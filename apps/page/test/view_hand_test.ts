// Camera, sun and lamps by hand on the page of `brume view`: pointer, keyboard, fingers. The program is made up (view_fake.ts).
import assert from "node:assert/strict";
import { join } from "node:path";
import test from "node:test";
import type { Locator } from "playwright-core";
import { comesTo, drawn, pixels, violations } from "./browser";
import {
  box,
  context,
  DESKTOP,
  drag,
  field,
  inBrowser,
  last,
  looks,
  middle,
  open,
  picture,
  says,
  shots,
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
});
