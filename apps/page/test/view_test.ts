// The page of `brume view` in a real browser: node view_test.mjs BRUME CHROMIUM FOLDER. Pictures of the page are left in
// FOLDER. Where exact pictures count, the page talks to view_fake.ts instead of the program.
import assert from "node:assert/strict";
import { spawn, type ChildProcess } from "node:child_process";
import { copyFileSync, mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { createServer, request, type Server } from "node:http";
import { connect, type AddressInfo, type Socket } from "node:net";
import { dirname, join } from "node:path";
import test, { after, before, describe } from "node:test";
import { fileURLToPath } from "node:url";
import type { Browser, BrowserContext, Locator, Page } from "playwright-core";
import { chromium, comesTo, drawn, middleOf, pixels, violations } from "./browser";
import { withFake, type Fake, type FakeOptions } from "./view_fake";

declare const PAGE_FOLDER: string;
const [brume, program, folder] = process.argv.slice(2) as [string, string, string];
const built = join(dirname(fileURLToPath(import.meta.url)), "..");
const data = join(PAGE_FOLDER, "..", "..", "data");
const shots = join(folder, "shots");
mkdirSync(shots, { recursive: true });

const DESKTOP = { width: 1280, height: 800 };
const SMALL = { width: 800, height: 460 };
const NARROW = { width: 320, height: 640 };

let browser: Browser;
/** What pages said that they should not have. */
const complaints: string[] = [];

async function context(viewport = DESKTOP, more: object = {}): Promise<BrowserContext> {
  const made = await browser.newContext({ viewport, acceptDownloads: true, deviceScaleFactor: 1, ...more });
  made.setDefaultTimeout(240_000);
  return made;
}

function listen(page: Page, expected: RegExp = /^$/): void {
  page.on("console", (m) => {
    if (["error", "warning"].includes(m.type()) && !expected.test(m.text())) complaints.push(m.text());
  });
  page.on("pageerror", (e) => complaints.push(String(e.stack)));
}

const picture = (page: Page) => page.locator("#picture");
const field = (page: Page, key: string) => page.locator(`[data-key="${key}"]`);
const box = async (locator: Locator) => (await locator.boundingBox())!;
const middle = async (locator: Locator) => {
  await locator.scrollIntoViewIfNeeded();
  const { x, y, width, height } = await box(locator);
  return { x: x + width / 2, y: y + height / 2 };
};

async function drag(page: Page, dx: number, dy: number, options: { button?: "left" | "right"; key?: string } = {}) {
  const { x, y } = await middle(picture(page));
  if (options.key) await page.keyboard.down(options.key);
  await page.mouse.move(x, y);
  await page.mouse.down({ button: options.button ?? "left" });
  await page.mouse.move(x + dx, y + dy, { steps: 8 });
  await page.mouse.up({ button: options.button ?? "left" });
  if (options.key) await page.keyboard.up(options.key);
}

/** A slider's value, as dragging it sets it. */
async function slide(slider: Locator, value: number): Promise<void> {
  await slider.evaluate((element, v) => {
    const input = element as HTMLInputElement;
    input.value = String(v);
    input.dispatchEvent(new Event("input", { bubbles: true }));
    input.dispatchEvent(new Event("change", { bubbles: true }));
  }, value);
}

before(async () => {
  browser = await chromium.launch({ executablePath: program, args: ["--disable-dev-shm-usage"] });
});
after(() => browser?.close());

describe("the page with a made-up program", () => {
  const ADDRESS = "http://127.0.0.1:18181/secret/";
  /** As the program answers. */
  const POLICY =
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; connect-src 'self' ws:; frame-ancestors 'none'; base-uri 'none'; form-action 'none'";
  const HTML =
    '<!doctype html><html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">' +
    '<title>brume view</title><link rel="icon" href="data:,"><link rel="stylesheet" href="view.css"></head>' +
    '<body><div id="app"></div><script src="view.js"></script></body></html>';

  async function open(made: BrowserContext, options: FakeOptions = {}, expected?: RegExp): Promise<Page> {
    const page = await made.newPage();
    listen(page, expected);
    await withFake(page, options);
    await page.route(`${ADDRESS}**`, (route) => {
      const name = new URL(route.request().url()).pathname.replace("/secret/", "");
      const headers = { "Content-Security-Policy": POLICY };
      if (name === "") return route.fulfill({ contentType: "text/html", body: HTML, headers });
      if (name === "view.js" || name === "view.css")
        return route.fulfill({
          contentType: name.endsWith("js") ? "text/javascript" : "text/css",
          body: readFileSync(join(built, name), "utf8"),
          headers,
        });
      const posted = route.request().postData();
      if (posted) kept.push({ name, state: JSON.parse(posted) as Kept["state"] });
      if (name === "scene.toml") return route.fulfill({ contentType: "application/toml", body: 'name = "ball"\n' });
      if (name === "command") return route.fulfill({ body: `brume render ${kept.at(-1)!.state.set.join(" ")}` });
      if (name === "frame.exr" && frameIsThere) return route.fulfill({ contentType: "image/x-exr", body: "v/1" });
      return route.fulfill({ status: 202, contentType: "text/plain", body: "no samples have been taken yet\n" });
    });
    await page.goto(ADDRESS);
    await drawn(picture(page));
    await page.locator('[data-panel="camera"]').waitFor();
    return page;
  }

  interface Kept {
    name: string;
    state: { type: string; set: string[]; size: [number, number]; moving: boolean; frame: number | null };
  }
  /** What pages asked for to keep. */
  const kept: Kept[] = [];
  let frameIsThere = false;

  /** Does something to the made-up program. */
  const fake = <T>(page: Page, what: (fake: Fake, argument: T) => void, argument?: T) =>
    page.evaluate(
      ([text, a]) => {
        const act = new Function(`return (${text as string})`)() as (f: Fake, argument: unknown) => void;
        act((window as unknown as { fake: Fake }).fake, a);
      },
      [String(what), argument] as const,
    );
  const sent = (page: Page) => page.evaluate(() => (window as unknown as { fake: Fake }).fake.sent);
  const looks = async (page: Page) => (await sent(page)).filter(({ type }) => type === "look");
  const last = async (page: Page) => (await looks(page)).at(-1)!;
  /** The latest state that was sent, once it says so. */
  const says = (page: Page, set: string[]) => comesTo(async () => (await last(page)).set, set);
  const vectorOf = (set: string[], key: string) =>
    JSON.parse(set.find((s) => s.startsWith(`${key}=`))?.slice(key.length + 1) ?? "[]") as number[];

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
    const [exr] = await Promise.all([page.waitForEvent("download"), (frameIsThere = true)]);
    assert.equal(exr.suggestedFilename(), "ball.exr");
    frameIsThere = false;
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

/** A running `brume view`, behind an address that stays when it is started again. */
class Program {
  private child: ChildProcess | undefined;
  private target: URL | undefined;
  private readonly sockets = new Set<Socket>();
  private server: Server | undefined;
  address = "";

  constructor(private readonly args: string[]) {}

  async start(): Promise<void> {
    const child = spawn(brume, ["view", ...this.args, "-q"], { stdio: ["ignore", "pipe", "inherit"] });
    this.child = child;
    this.target = await new Promise<URL>((resolve, reject) => {
      child.stdout.once("data", (text: Buffer) => resolve(new URL(text.toString().trim())));
      child.once("exit", (code) => reject(new Error(`brume view ended with ${code}`)));
    });
    if (!this.server) await this.forward();
  }

  /** Passes requests on under the program's own address: it answers no others. */
  private async forward(): Promise<void> {
    const place = (url: string) => this.target!.pathname + url.replace(/^\//, "");
    const headers = (all: NodeJS.Dict<string | string[]>) => ({
      ...all,
      host: this.target!.host,
      ...(all["origin"] ? { origin: this.target!.origin } : {}),
    });
    const server = createServer((from, to) => {
      const passed = request({
        host: this.target!.hostname,
        port: this.target!.port,
        method: from.method,
        path: place(from.url!),
        headers: headers(from.headers),
      });
      passed.on("response", (answer) => {
        to.writeHead(answer.statusCode!, answer.headers);
        answer.pipe(to);
      });
      passed.on("error", () => to.destroy());
      from.pipe(passed);
    });
    server.on("upgrade", (from, socket: Socket) => {
      const other = connect(Number(this.target!.port), this.target!.hostname, () => {
        const lines = Object.entries(headers(from.headers)).map(([name, value]) => `${name}: ${String(value)}`);
        other.write(`GET ${place(from.url!)} HTTP/1.1\r\n${lines.join("\r\n")}\r\n\r\n`);
        socket.pipe(other).pipe(socket);
      });
      for (const end of [socket, other]) {
        this.sockets.add(end);
        end.on("error", () => {});
        end.on("close", () => {
          socket.destroy();
          other.destroy();
        });
      }
    });
    await new Promise<void>((resolve) => server.listen(0, "127.0.0.1", resolve));
    this.server = server;
    this.address = `http://127.0.0.1:${(server.address() as AddressInfo).port}/`;
  }

  async kill(): Promise<void> {
    const child = this.child;
    if (!child || child.exitCode !== null || child.signalCode !== null) return;
    child.removeAllListeners("exit");
    await new Promise((resolve) => {
      child.once("exit", resolve);
      child.kill("SIGKILL");
    });
  }

  async end(): Promise<void> {
    await this.kill();
    for (const socket of this.sockets) socket.destroy();
    this.server?.closeAllConnections();
    this.server?.close();
  }
}

describe("the page with the program", () => {
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

test("no page said anything unexpected", () => assert.deepEqual(complaints, []));
