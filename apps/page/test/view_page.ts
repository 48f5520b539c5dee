// What tests of the page of `brume view` share: a real browser, the page with a made-up program or with the real one. Run as
// node TEST.mjs BRUME CHROMIUM FOLDER, they leave pictures of the page in FOLDER.
import assert from "node:assert/strict";
import { spawn, type ChildProcess } from "node:child_process";
import { mkdirSync, readFileSync } from "node:fs";
import { createServer, request, type Server } from "node:http";
import { connect, type AddressInfo, type Socket } from "node:net";
import { dirname, join } from "node:path";
import test, { after } from "node:test";
import { fileURLToPath } from "node:url";
import type { Browser, BrowserContext, Locator, Page } from "playwright-core";
import { chromium, comesTo, drawn } from "./browser";
import { withFake, type Fake, type FakeOptions } from "./view_fake";

declare const PAGE_FOLDER: string;
export const [brume, program, folder] = process.argv.slice(2) as [string, string, string];
const built = join(dirname(fileURLToPath(import.meta.url)), "..");
export const data = join(PAGE_FOLDER, "..", "..", "data");
export const shots = join(folder, "shots");
mkdirSync(shots, { recursive: true });

export const DESKTOP = { width: 1280, height: 800 };
export const SMALL = { width: 800, height: 460 };
export const NARROW = { width: 320, height: 640 };

/** Launched by the first page: hooks of a file may ask for one before those of others have run. */
let launching: Promise<Browser> | undefined;
/** What pages said that they should not have. */
const complaints: string[] = [];

export async function context(viewport = DESKTOP, more: object = {}): Promise<BrowserContext> {
  launching ??= chromium.launch({ executablePath: program, args: ["--disable-dev-shm-usage"] });
  const made = await (await launching).newContext({ viewport, acceptDownloads: true, deviceScaleFactor: 1, ...more });
  made.setDefaultTimeout(240_000);
  return made;
}

export function listen(page: Page, expected: RegExp = /^$/): void {
  page.on("console", (m) => {
    if (["error", "warning"].includes(m.type()) && !expected.test(m.text())) complaints.push(m.text());
  });
  page.on("pageerror", (e) => complaints.push(String(e.stack)));
}

export const picture = (page: Page) => page.locator("#picture");
export const field = (page: Page, key: string) => page.locator(`[data-key="${key}"]`);
export const box = async (locator: Locator) => (await locator.boundingBox())!;
export const middle = async (locator: Locator) => {
  await locator.scrollIntoViewIfNeeded();
  const { x, y, width, height } = await box(locator);
  return { x: x + width / 2, y: y + height / 2 };
};

export async function drag(page: Page, dx: number, dy: number, options: { button?: "left" | "right"; key?: string } = {}) {
  const { x, y } = await middle(picture(page));
  if (options.key) await page.keyboard.down(options.key);
  await page.mouse.move(x, y);
  await page.mouse.down({ button: options.button ?? "left" });
  await page.mouse.move(x + dx, y + dy, { steps: 8 });
  await page.mouse.up({ button: options.button ?? "left" });
  if (options.key) await page.keyboard.up(options.key);
}

/** A slider's value, as dragging it sets it. */
export async function slide(slider: Locator, value: number): Promise<void> {
  await slider.evaluate((element, v) => {
    const input = element as HTMLInputElement;
    input.value = String(v);
    input.dispatchEvent(new Event("input", { bubbles: true }));
    input.dispatchEvent(new Event("change", { bubbles: true }));
  }, value);
}

/** Has the file's tests run in a browser, and judges at their end what pages said. */
export function inBrowser(tests: () => void): void {
  tests();
  test("no page said anything unexpected", () => assert.deepEqual(complaints, []));
  after(async () => (await launching)?.close());
}

// The page with a made-up program (view_fake.ts).

export const ADDRESS = "http://127.0.0.1:18181/secret/";
/** As the program answers. */
const POLICY =
  "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; connect-src 'self' ws:; frame-ancestors 'none'; base-uri 'none'; form-action 'none'";
const HTML =
  '<!doctype html><html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">' +
  '<title>brume view</title><link rel="icon" href="data:,"><link rel="stylesheet" href="view.css"></head>' +
  '<body><div id="app"></div><script src="view.js"></script></body></html>';

export async function open(made: BrowserContext, options: FakeOptions = {}, expected?: RegExp): Promise<Page> {
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
    if (name === "mix") return route.fulfill({ contentType: "application/json", body: '["lights.0.irradiance=[1.7, 1.5, 1.2]"]' });
    if (name === "command") return route.fulfill({ body: `brume render ${kept.at(-1)!.state.set.join(" ")}` });
    if (name === "frame.exr" && frame.isThere) return route.fulfill({ contentType: "image/x-exr", body: "v/1" });
    return route.fulfill({ status: 202, contentType: "text/plain", body: "no samples have been taken yet\n" });
  });
  await page.goto(ADDRESS);
  await drawn(picture(page));
  await page.locator('[data-panel="camera"]').waitFor();
  return page;
}

export interface Kept {
  name: string;
  state: {
    type: string;
    set: string[];
    size: [number, number];
    moving: boolean;
    frame: number | null;
    mix?: Record<string, number[]>;
  };
}
/** What pages asked for to keep. */
export const kept: Kept[] = [];
/** Whether the made-up program has a frame to keep. */
export const frame = { isThere: false };

/** Does something to the made-up program. */
export const fake = <T>(page: Page, what: (fake: Fake, argument: T) => void, argument?: T) =>
  page.evaluate(
    ([text, a]) => {
      const act = new Function(`return (${text as string})`)() as (f: Fake, argument: unknown) => void;
      act((window as unknown as { fake: Fake }).fake, a);
    },
    [String(what), argument] as const,
  );
export const sent = (page: Page) => page.evaluate(() => (window as unknown as { fake: Fake }).fake.sent);
export const looks = async (page: Page) => (await sent(page)).filter(({ type }) => type === "look");
export const last = async (page: Page) => (await looks(page)).at(-1)!;
/** The latest state that was sent, once it says so. */
export const says = (page: Page, set: string[]) => comesTo(async () => (await last(page)).set, set);
export const vectorOf = (set: string[], key: string) =>
  JSON.parse(set.find((s) => s.startsWith(`${key}=`))?.slice(key.length + 1) ?? "[]") as number[];


/** A running `brume view`, behind an address that stays when it is started again. */
export class Program {
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
