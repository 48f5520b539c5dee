// What tests of the page of `brume evaluate` share: a real browser, a page of made-up results, and one of results that the
// program measured. Run as node TEST.mjs BRUME CHROMIUM FOLDER, they leave their pages in FOLDER/TEST.
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { basename, dirname, join } from "node:path";
import test, { after, before } from "node:test";
import { fileURLToPath, pathToFileURL } from "node:url";
import type { Browser, BrowserContext, Page } from "playwright-core";
import { chromium } from "./browser";
import { fixture } from "./fixture";

declare const PAGE_FOLDER: string;

export const [brume, program, parent] = process.argv.slice(2) as [string, string, string];
export const folder = join(parent, basename(process.argv[1]!, "_test.mjs"));
mkdirSync(folder, { recursive: true });

export const DESKTOP = { width: 1440, height: 900 };
export const PHONE = { width: 390, height: 844 };

let browser: Browser;
/** What pages said or asked for that they should not have. */
const complaints: string[] = [];

export async function open(context: BrowserContext, file: string, hash = ""): Promise<Page> {
  const page = await context.newPage();
  const complain = (what: string) => complaints.push(`${page.url()}: ${what}`);
  page.on("console", (m) => ["error", "warning"].includes(m.type()) && complain(m.text()));
  page.on("pageerror", (e) => complain(String(e.stack)));
  page.on("request", (r) => /^(about|file|data|blob):/.test(r.url()) || complain(`asked for ${r.url()}`));
  await load(page, file, hash);
  return page;
}

/** Loads a file as if a new page were opened, which takes the browser's processes two seconds more. */
export async function load(page: Page, file: string, hash: string): Promise<void> {
  if (page.url() !== "about:blank") await page.goto("about:blank"); // another hash alone loads nothing
  await page.goto(pathToFileURL(file).href + (hash ? `#${hash}` : ""));
  await page.locator(".methods li").first().waitFor();
}

/** A context without a network. */
export async function reader(viewport = DESKTOP, colorScheme: "light" | "dark" = "dark"): Promise<BrowserContext> {
  const context = await browser.newContext({
    viewport,
    colorScheme,
    offline: true,
    hasTouch: viewport === PHONE,
    deviceScaleFactor: 1,
  });
  context.setDefaultTimeout(120_000);
  return context;
}

/** The link to what is shown, once it is as it should be: it follows the view after a while. */
export async function linkOnce(page: Page, right: (link: URLSearchParams) => boolean): Promise<URLSearchParams> {
  for (let i = 0; ; ++i) {
    const link = new URLSearchParams(new URL(page.url()).hash.slice(1));
    if (right(link)) return link;
    assert.ok(i < 200, `the link says ${link}`);
    await page.waitForTimeout(50);
  }
}

/** Waits until the link says so: null where it is to say nothing. */
export async function linkSays(page: Page, name: string, value: string | null): Promise<void> {
  await linkOnce(page, (link) => link.get(name) === value);
}

/** A page of made-up results. */
export const made = join(folder, "made_up.html");

/** The same page of other results. @return its file */
export function pageOf(name: string, results: object): string {
  const file = join(folder, name);
  const json = JSON.stringify(results).replaceAll("<", "\\u003c");
  writeFileSync(
    file,
    readFileSync(made, "utf8").replace(/id="results">[^<]*</, () => `id="results">${json}<`),
  );
  return file;
}

/** A small evaluation by the program. @return its folder */
export function evaluation(): string {
  const evaluated = join(folder, "evaluation");
  const scenes = join(PAGE_FOLDER, "..", "..", "data", "scenes");
  const filters = ["bilateral", "gradient_kernel", "nl_means"].flatMap((f) => ["-f", f]);
  const small = ["--size", "40", "--spp", "2,4", "--seeds", "2", "--reference-spp", "16", "--no-tuning", "-q"];
  execFileSync(brume, ["evaluate", join(scenes, "smoke.toml"), join(scenes, "cloud.toml"), ...small, ...filters, "-o", evaluated], {
    stdio: "ignore",
  });
  return evaluated;
}

/** Which methods the answer on top names, by question. */
export async function told(page: Page): Promise<Record<string, string | null>> {
  return page.locator(".answer .one").evaluateAll((all) =>
    Object.fromEntries(
      all.flatMap((one) => {
        const { question, method } = (one as HTMLElement).dataset;
        return question!.split(" ").map((q) => [q, method ?? null]);
      }),
    ),
  );
}

before(async () => {
  const built = join(dirname(fileURLToPath(import.meta.url)), "..");
  const { html } = fixture();
  writeFileSync(
    made,
    html(readFileSync(join(built, "page.js"), "utf8"), readFileSync(join(built, "page.css"), "utf8")),
  );
  browser = await chromium.launch({ executablePath: program, args: ["--disable-dev-shm-usage"] });
});
after(() => browser?.close());

/** Stands at the end of each file. */
export function judgeWhatPagesSaid(): void {
  test("said nothing to the console and asked no host", () => assert.deepEqual(complaints, []));
}
