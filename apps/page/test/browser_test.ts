// The page in a real browser: node browser_test.mjs BRUME CHROMIUM FOLDER. The pages and a picture of each view are left
// in FOLDER.
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { dirname, join } from "node:path";
import test, { after, before, describe } from "node:test";
import { fileURLToPath, pathToFileURL } from "node:url";
import type { Browser, BrowserContext, Locator, Page } from "playwright-core";
import { fromBase64, inflate, unpredict } from "../src/half";
import { errorMap } from "../src/library";
import { Picture } from "../src/picture";
import type { PictureEntry, Results } from "../src/results";
import { chromium, comesTo, drawn, middleOf, pixels, violations } from "./browser";
import { fixture } from "./fixture";

declare const PAGE_FOLDER: string;

const [brume, program, folder] = process.argv.slice(2) as [string, string, string];
const shots = join(folder, "views");
mkdirSync(shots, { recursive: true });

const DESKTOP = { width: 1440, height: 900 };
const PHONE = { width: 390, height: 844 };

let browser: Browser;
/** What pages said or asked for that they should not have. */
const complaints: string[] = [];

async function open(context: BrowserContext, file: string, hash = ""): Promise<Page> {
  const page = await context.newPage();
  const complain = (what: string) => complaints.push(`${page.url()}: ${what}`);
  page.on("console", (m) => ["error", "warning"].includes(m.type()) && complain(m.text()));
  page.on("pageerror", (e) => complain(String(e.stack)));
  page.on("request", (r) => /^(about|file|data|blob):/.test(r.url()) || complain(`asked for ${r.url()}`));
  await load(page, file, hash);
  return page;
}

/** Loads a file as if a new page were opened, which takes the browser's processes two seconds more. */
async function load(page: Page, file: string, hash: string): Promise<void> {
  if (page.url() !== "about:blank") await page.goto("about:blank"); // another hash alone loads nothing
  await page.goto(pathToFileURL(file).href + (hash ? `#${hash}` : ""));
  await page.locator(".methods li").first().waitFor();
}

/** A context without a network. */
async function reader(viewport = DESKTOP, colorScheme: "light" | "dark" = "dark"): Promise<BrowserContext> {
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
async function linkOnce(page: Page, right: (link: URLSearchParams) => boolean): Promise<URLSearchParams> {
  for (let i = 0; ; ++i) {
    const link = new URLSearchParams(new URL(page.url()).hash.slice(1));
    if (right(link)) return link;
    assert.ok(i < 200, `the link says ${link}`);
    await page.waitForTimeout(50);
  }
}

/** Waits until the link says so: null where it is to say nothing. */
async function linkSays(page: Page, name: string, value: string | null): Promise<void> {
  await linkOnce(page, (link) => link.get(name) === value);
}

const made = join(folder, "made_up.html");
const evaluated = join(folder, "evaluation");
const { html } = fixture();

before(async () => {
  const built = join(dirname(fileURLToPath(import.meta.url)), "..");
  writeFileSync(
    made,
    html(readFileSync(join(built, "page.js"), "utf8"), readFileSync(join(built, "page.css"), "utf8")),
  );
  const scenes = join(PAGE_FOLDER, "..", "..", "data", "scenes");
  const filters = ["bilateral", "gradient_kernel", "nl_means"].flatMap((f) => ["-f", f]);
  const small = ["--size", "40", "--spp", "2,4", "--seeds", "2", "--reference-spp", "16", "--no-tuning", "-q"];
  execFileSync(
    brume,
    ["evaluate", join(scenes, "smoke.toml"), join(scenes, "cloud.toml"), ...small, ...filters, "-o", evaluated],
    { stdio: "ignore" },
  );
  browser = await chromium.launch({ executablePath: program, args: ["--disable-dev-shm-usage"] });
});
after(() => browser?.close());

describe("the page that brume evaluate writes", () => {
  const file = join(evaluated, "index.html");

  test("shows every method and the numbers of results.json", async () => {
    const results = JSON.parse(readFileSync(join(evaluated, "results.json"), "utf8")) as Results;
    const context = await reader();
    const page = await open(context, file);
    for (const scene of results.scenes)
      for (const spp of results.spp)
        for (const region of ["medium", "frame"]) {
          await load(page, file, `tab=numbers&setting=&scene=${scene.name}&spp=${spp}&region=${region}`);
          const listed = await page
            .locator(".methods li")
            .evaluateAll((rows) => rows.map((r) => (r as HTMLElement).dataset["method"]));
          assert.deepEqual(listed.sort(), ["reference", ...results.methods.map((m) => m.id)].sort());
          await comesTo(
            () => page.locator(".metrics td[data-metric]").count(),
            results.methods.length * results.metrics.length,
          );
          const cells = await page
            .locator(".metrics td[data-metric]")
            .evaluateAll((all) =>
              all.map(
                (td) =>
                  [
                    td.closest("tr")!.dataset["method"]!,
                    (td as HTMLElement).dataset["metric"]!,
                    (td as HTMLElement).dataset["value"]!,
                    td.textContent!,
                  ] as const,
              ),
            );
          for (const [method, metric, value, text] of cells) {
            const row = results.rows.find(
              (r) => r.scene === scene.name && r.spp === spp && r.method === method && r.region === region,
            )!;
            const { mean } = row.metrics[metric]!;
            assert.equal(Number(value), mean, `${method} ${metric}`);
            const printed = Number(
              text.replace(/[●○]/g, "").split("±")[0]!.replace("−", "-").replace("e−", "e-").trim(),
            );
            assert.ok(Math.abs(printed - mean) <= 0.006 * Math.abs(mean), `${text} is not ${mean}`);
          }
        }
    await context.close();
  });

  test("holds the pictures that the EXRs hold", async () => {
    const text = readFileSync(file, "utf8");
    const part = (id: string) => text.match(new RegExp(`id="${id}">([^<]*)</script>`))![1]!;
    const entries = JSON.parse(part("pictures")) as PictureEntry[];
    const load = async (e: PictureEntry) =>
      new Picture(
        e.width,
        e.height,
        unpredict(await inflate(fromBase64(part(`picture-${e.data}`))), e.width, e.height),
      );
    const reference = entries.find((e) => e.scene === "smoke" && e.spp === 0)!;
    for (const method of ["noisy", "bilateral_default"]) {
      const picture = await load(entries.find((e) => e.scene === "smoke" && e.spp === 2 && e.method === method)!);
      const map = errorMap("lab", picture, await load(reference), 1);
      const rms = Math.sqrt(map.reduce((sum, e) => sum + e * e, 0) / map.length);
      const names = [`smoke_2spp_${method}.exr`, "smoke_reference.exr"].map((name) => join(evaluated, name));
      const compared = JSON.parse(execFileSync(brume, ["compare", ...names, "--json"], { encoding: "utf8" })) as {
        metrics: { lab_rms: number };
      };
      assert.ok(
        Math.abs(rms - compared.metrics.lab_rms) < 2e-3 * rms,
        `${method}: ${rms} is not ${compared.metrics.lab_rms}`,
      );
    }
  });
});

describe("looking at pictures", () => {
  test("the divider follows keys and pointer", async () => {
    const context = await reader();
    const page = await open(context, made);
    const canvas = page.locator(".stage canvas");
    const first = await drawn(canvas);
    await page.keyboard.press("ArrowLeft");
    await page.keyboard.press("ArrowLeft");
    const second = await drawn(canvas, first);
    await linkSays(page, "split", "0.46");
    const box = (await canvas.boundingBox())!;
    await page.mouse.move(box.x + box.width / 2, box.y + 200);
    await page.mouse.down();
    await page.mouse.move(box.x + box.width / 4, box.y + 200, { steps: 4 });
    await page.mouse.up();
    await drawn(canvas, second);
    await linkOnce(page, (link) => Math.abs(Number(link.get("split")) - 0.25) < 0.01);
    await page.getByRole("separator").focus();
    await page.keyboard.press("End");
    await linkSays(page, "split", "1");
    await context.close();
  });

  test("the wheel zooms at the pointer, a drag moves, 0 shows all again", async () => {
    const context = await reader();
    const page = await open(context, made);
    const canvas = page.locator(".stage canvas");
    const whole = await drawn(canvas);
    const box = (await canvas.boundingBox())!;
    await page.mouse.move(box.x + box.width * 0.6, box.y + box.height * 0.4);
    const where = page.locator(".probe .where");
    const pixel = await where.textContent();
    await page.mouse.wheel(0, -900);
    const close = await drawn(canvas, whole);
    await comesTo(() => where.textContent(), pixel);
    await linkOnce(page, (link) => Number(link.get("zoom")) > 2);
    await page.mouse.move(box.x + box.width * 0.8, box.y + box.height * 0.5);
    await page.mouse.down();
    await page.mouse.move(box.x + box.width * 0.7, box.y + box.height * 0.6, { steps: 3 });
    await page.mouse.up();
    await drawn(canvas, close);
    await page.keyboard.press("0");
    await linkOnce(page, (link) => link.get("zoom") === null && link.get("x") === null);
    await context.close();
  });

  test("values under the pointer are those of the picture", async () => {
    const context = await reader();
    const page = await open(context, made);
    const canvas = page.locator(".stage canvas");
    await drawn(canvas);
    const box = (await canvas.boundingBox())!;
    await page.mouse.move(box.x + box.width / 2 + 1, box.y + box.height / 2 + 1);
    await comesTo(() => page.locator(".probe .where").textContent(), "20, 15");
    // The made-up ball is brightest there: 0.2 + 0.6 in red.
    const cells = page.locator(".probe tbody tr").nth(2).locator("td");
    await comesTo(() => cells.nth(0).textContent(), "0.800");
    await comesTo(() => cells.nth(1).textContent(), "0.850");
    await context.close();
  });

  test("with the keyboard on the picture the pixel in the middle is read", async () => {
    const context = await reader();
    const page = await open(context, made);
    await drawn(page.locator(".stage canvas"));
    await page.keyboard.press("Tab");
    await page.locator(".stage canvas").focus();
    await comesTo(() => page.locator(".probe .where").textContent(), "20, 15");
    for (const key of ["+", "+", "+", "+", "d"]) await page.keyboard.press(key);
    await page.waitForFunction(() => document.querySelector(".probe .where")?.textContent !== "20, 15");
    await context.close();
  });

  test("keys do what the help says", async () => {
    const context = await reader();
    const page = await open(context, made);
    const canvas = page.locator("canvas").first();
    const first = await drawn(canvas);
    const press = async (...keys: string[]) => {
      for (const key of keys) await page.keyboard.press(key);
    };
    const turns = async (keys: string[], name: string, value: string | null) => {
      await press(...keys);
      await linkSays(page, name, value);
    };
    await turns(["ArrowDown"], "b", "nl_means_searched");
    await turns(["Shift+ArrowUp"], "a", "bilateral_searched");
    await turns(["x"], "a", "nl_means_searched");
    await turns(["r"], "a", "reference");
    await turns(["]", "]"], "stops", "1");
    await turns(["\\"], "stops", null);
    await turns(["t"], "tone", "filmic");
    await turns(["e"], "show", "error");
    await turns(["k"], "error", "luminance");
    await turns([">"], "gain", "1");
    await turns(["2"], "mode", "flip");
    await turns([" "], "front", "a");
    await turns(["3"], "mode", "grid");
    await comesTo(() => page.locator(".tile").count(), 6);
    await turns(["."], "spp", "16");
    await turns(["m"], "scene", "smoke");
    await turns(["f"], "region", "frame");
    await turns(["c"], "metric", "psnr");
    for (const [key, tab] of [
      ["n", "numbers"],
      ["p", "plots"],
      ["b", "ablation"],
      ["v", "sensitivity"],
      ["i", "about"],
    ] as const)
      await turns([key], "tab", tab);
    await press("l", "?");
    const dialog = page.getByRole("dialog");
    await dialog.waitFor({ state: "visible" });
    await press("Escape");
    await dialog.waitFor({ state: "hidden" });
    const theme = () => page.evaluate(() => document.documentElement.dataset["theme"]);
    assert.equal(await theme(), "dark");
    await press("u");
    await comesTo(theme, "light");
    assert.notEqual(await drawn(canvas), first);
    await context.close();
  });

  test("what is done between two drawings of the page counts", async () => {
    const context = await reader();
    const page = await open(context, made);
    await drawn(page.locator("canvas").first());
    // Clicks and keys of one script: the browser draws after its end.
    const act = (...steps: string[]) =>
      page.evaluate((steps) => {
        const key = (key: string) =>
          (document.activeElement ?? document.body).dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true }));
        for (const step of steps) {
          const [what, name] = step.split(": ");
          if (what === "key") key(name === "Space" ? " " : name!);
          else if (what === "close") document.querySelector("dialog")!.close();
          else document.querySelector<HTMLElement>(name!)!.click();
        }
      }, steps);
    const dialog = page.getByRole("dialog");

    await act("key: ?", "close", "key: u");
    await comesTo(() => page.evaluate(() => document.documentElement.dataset["theme"]), "light");
    await act("key: ?", "close", "key: ?");
    await dialog.waitFor({ state: "visible" });
    await act("close", "key: 2", "key: Space");
    await linkSays(page, "front", "a");
    await act("click: .stage canvas", "key: 1");
    await page.locator("#tab-look").focus();
    await act("key: ArrowRight", "key: ArrowRight");
    await linkSays(page, "tab", "plots");
    await act("key: n");
    await page.locator(".metrics thead button").first().waitFor();
    await act("click: .metrics th:nth-child(4) button", "click: .metrics th:nth-child(4) button");
    await linkSays(page, "descending", "true");
    await act("click: .methods li:nth-child(2) input", "click: .methods li:nth-child(3) input");
    await linkOnce(page, (link) => link.get("hidden")?.split("|").length === 2);
    await act("key: l", "key: e");
    await page.getByRole("separator").focus();
    await act("key: ArrowRight", "key: ArrowRight", "key: PageDown");
    await linkSays(page, "split", "0.34");
    await act("click: [title='Double the scale (>)']", "click: [title='Double the scale (>)']");
    await linkSays(page, "gain", "2");
    const pair = (link: URLSearchParams) => [link.get("a"), link.get("b")];
    const before = pair(new URL(page.url().replace("#", "?")).searchParams);
    await act("click: [title='Exchange A and B (x)']", "click: [title='Exchange A and B (x)']", "key: t");
    assert.deepEqual(pair(await linkOnce(page, (link) => link.get("tone") !== null)), before);
    await page.evaluate(() => {
      const writeText = async (text: string) => void (document.title = text);
      Object.defineProperty(navigator, "clipboard", { value: { writeText } });
    });
    await act("key: 3", "key: y");
    await comesTo(async () => (await page.title()).includes("mode=grid"), true);
    await context.close();
  });

  test("a link shows the same view again", async () => {
    const context = await reader();
    const page = await open(
      context,
      made,
      "scene=smoke&spp=16&mode=flip&b=bilateral_searched&show=error&gain=-1&zoom=3&x=0.4&y=0.6",
    );
    const seen = await drawn(page.locator(".stage canvas"));
    const again = await open(context, made, (await linkOnce(page, (link) => link.get("zoom") === "3")).toString());
    await comesTo(() => pixels(again.locator(".stage canvas")), seen);
    await context.close();
  });

  test("tiles of the grid zoom together", async () => {
    const context = await reader();
    const page = await open(context, made, "mode=grid");
    const [one, other] = [page.locator(".tile canvas").nth(1), page.locator(".tile canvas").nth(3)];
    const [before, beforeOther] = [await drawn(one), await drawn(other)];
    await one.hover();
    await page.mouse.wheel(0, -600);
    await drawn(one, before);
    await drawn(other, beforeOther);
    await context.close();
  });
});

/** What a click saves. */
async function saved(page: Page, button: Locator): Promise<{ name: string; bytes: Buffer }> {
  const [download] = await Promise.all([page.waitForEvent("download"), button.click()]);
  return { name: download.suggestedFilename(), bytes: readFileSync((await download.path())!) };
}

/** Texts by question. */
async function told(page: Page): Promise<Record<string, string | null>> {
  return page.locator(".answer .one").evaluateAll((all) =>
    Object.fromEntries(
      all.flatMap((one) => {
        const { question, method } = (one as HTMLElement).dataset;
        return question!.split(" ").map((q) => [q, method ?? null]);
      }),
    ),
  );
}

describe("the answer on top", () => {
  const [regression, means, kernel] = ["transport_regression", "nl_means", "gradient_kernel"] as const;

  test("tells the best of all, the best quick one and the best without guides, with numbers and what is level", async () => {
    const context = await reader();
    const page = await open(context, made);
    await comesTo(() => told(page), {
      best: `${regression}_searched`,
      quick: `${means}_searched`,
      plain: `${means}_searched`,
    });
    const text = (await page.locator(".answer").textContent())!.replace(/\u200b/g, "");
    assert.match(
      text,
      /transport_regressionLab RMS 2\.000, 8\.0 times less than path tracing750 ms a frame, at most 875 ms; 1\.0 MiB/,
    );
    assert.match(text, /nl_meansLab RMS 2\.125.*Level with it within the noise of the seeds: gradient_kernel/);
    assert.match(text, /Geometric means over cloud, smoke at 4, 16 spp, pixels of the medium, searched parameters/);
    assert.match(text, /paired differences over 3 seeds/);
    await context.close();
  });

  test("follows region, metric, setting and the methods that are left out", async () => {
    const context = await reader();
    const page = await open(context, made, "region=frame");
    const value = () => page.locator("[data-question~=best] b").first().textContent();
    await comesTo(value, "1.000");
    await page.keyboard.press("f");
    await comesTo(value, "2.000");
    await page.keyboard.press("c");
    await comesTo(value, "12.00");
    await comesTo(async () => (await page.locator(".answer .note").textContent())!.startsWith("Means over"), true);
    await page.keyboard.press("c");
    await comesTo(() => told(page), {});
    assert.match((await page.locator(".answer").textContent())!, /No method is the best .* by relative bias/);
    await page.keyboard.press("c");
    for (const name of [regression, means]) await page.getByRole("checkbox", { name }).uncheck();
    await comesTo(() => told(page), {
      best: `${kernel}_searched`,
      quick: `${kernel}_searched`,
      plain: `${kernel}_searched`,
    });
    await page.getByLabel("Parameters").selectOption("default");
    await comesTo(async () => (await told(page))["best"], `${regression}_default`);
    await page.locator("[data-question~=quick] button").click();
    await linkSays(page, "b", `${means}_default`);
    await context.close();
  });

  test("warns where the references are noisier than the best method", async () => {
    const context = await reader();
    const page = await open(context, made, "region=medium");
    const warning = page.locator(".answer .warning");
    await comesTo(() => warning.count(), 1);
    assert.match(
      (await warning.textContent())!,
      /noisier than the best method: cloud at 16 spp.*cloud, 16 spp: Lab RMS 1\.250 of the references' mean, 1\.020 of transport_regression/,
    );
    await page.keyboard.press("f");
    await comesTo(() => warning.count(), 0);
    await context.close();
  });

  test("says what it is without: methods that failed, and what one seed cannot tell", async () => {
    const odd = join(folder, "odd.html");
    const { results } = fixture();
    for (const group of results.overall) {
      group.seeds = 1;
      group.methods = group.methods.filter((m) => m.method !== "nl_means_searched");
      if (group.setting === "searched") group.left_out = [{ method: "nl_means_searched", why: "failed on smoke" }];
    }
    const json = JSON.stringify(results).replaceAll("<", "\\u003c");
    writeFileSync(
      odd,
      readFileSync(made, "utf8").replace(/id="results">[^<]*</, () => `id="results">${json}<`),
    );
    const context = await reader();
    const page = await open(context, odd);
    const summary = page.locator(".answer details.note summary");
    await comesTo(
      () => summary.textContent(),
      "Geometric means over cloud, smoke at 4, 16 spp, pixels of the medium, searched parameters; one seed: what is level within its noise cannot be told, without nl_means",
    );
    assert.match((await page.locator(".answer").textContent())!, /nl_means \(failed on smoke\)/);
    await page.getByRole("checkbox", { name: "nl_means" }).uncheck();
    await comesTo(async () => (await page.locator(".answer").textContent())!.includes("nl_means"), false);
    await context.close();
  });

  test("is results.json's of a real evaluation", async () => {
    const results = JSON.parse(readFileSync(join(evaluated, "results.json"), "utf8")) as Results;
    const context = await reader();
    const file = join(evaluated, "index.html");
    const page = await open(context, file);
    for (const region of ["medium", "frame"] as const)
      for (const metric of ["lab_rms", "psnr", "flip"]) {
        await load(page, file, `region=${region}&metric=${metric}&setting=default`);
        const own = results.overall.find((o) => o.region === region && o.metric === metric && o.setting === "default")!;
        assert.equal(own.methods.length, 4, "path tracing and three filters");
        assert.deepEqual(own.scenes, ["smoke", "cloud"]);
        const first = (takes: (m: (typeof own.methods)[0]) => boolean) => own.methods.find(takes)?.method ?? null;
        await comesTo(() => told(page), {
          best: own.methods[0]!.method,
          quick: first((m) => m.most_seconds < 0.5),
          plain: first((m) => !m.guides),
        });
        const front = results.pareto.find(
          (f) => f.scene === "smoke" && f.region === region && f.metric === metric && f.setting === "default",
        );
        assert.ok(front && front.front.length > 0);
      }
    await context.close();
  });
});

describe("what is listed and saved", () => {
  test("time to an error follows region and metric, and lists nothing that is filtered out", async () => {
    const context = await reader();
    const page = await open(context, made, "tab=numbers&region=frame");
    const rows = page.locator(".times tbody tr");
    const listed = () =>
      rows.evaluateAll((all) =>
        all.map(
          (r) => `${(r as HTMLElement).dataset["method"]} ${r.children[1]!.textContent} ${r.children[2]!.textContent}`,
        ),
      );
    await comesTo(listed, ["noisy 1.000 250 ms", "nl_means_searched 1.000 750 ms", "bilateral_searched 1.000 1.00 s"]);
    await page.keyboard.press("f");
    await comesTo(listed, ["noisy 2.000 500 ms", "nl_means_searched 2.000 1.50 s", "bilateral_searched 2.000 2.00 s"]);
    await page.keyboard.press("c");
    await comesTo(async () => (await listed())[0], "noisy 12.00 500 ms");
    await page.getByRole("checkbox", { name: "nl_means" }).uncheck();
    await comesTo(() => rows.count(), 2);
    await page.getByLabel("Parameters").selectOption("default");
    await comesTo(listed, ["noisy 12.00 500 ms", "nl_means_default 12.00 1.00 s"]);
    await context.close();
  });

  test("failures of methods that are not listed are counted, not listed", async () => {
    const context = await reader();
    const page = await open(context, made, "tab=numbers&scene=smoke&setting=default");
    const section = page.locator(".section").filter({ hasText: "What failed" });
    await comesTo(() => section.locator("li").count(), 0);
    assert.match((await section.textContent())!, /Nothing here; 1 more among the methods that are not listed/);
    await context.close();
  });

  for (const viewport of [{ width: 1400, height: 900 }, PHONE])
    test(`seconds and memory are seen beside the error at ${viewport.width} pixels`, async () => {
      const context = await reader(viewport);
      const page = await open(context, made, "tab=numbers");
      const row = page.locator(".metrics.main tr[data-method=transport_regression_searched]");
      const seen = await row
        .locator("td")
        .evaluateAll((cells) =>
          cells.filter((c) => c.getBoundingClientRect().right <= innerWidth).map((c) => c.textContent!),
        );
      // The metric, seconds in all and memory, whatever else.
      assert.match(seen[0]!, /^●?2\.04/);
      assert.equal(seen[1], "510 ms");
      assert.equal(seen[2], "24 MiB");
      const beside = page.locator(".methods li[data-method=transport_regression_searched] .bar");
      assert.equal((await beside.textContent())!, "2.040510 ms24 MiB");
      const inside = await beside.evaluate((bar) =>
        [...bar.children].every(
          (c) => c.getBoundingClientRect().right <= bar.closest(".what")!.getBoundingClientRect().right,
        ),
      );
      assert.ok(inside, "nothing is cut off");
      await context.close();
    });

  test("tables are saved as CSV with every digit, of the methods that are shown", async () => {
    const { results } = fixture();
    const context = await reader();
    const page = await open(context, made, "tab=numbers&scene=smoke&hidden=noisy");
    const { name, bytes } = await saved(page, page.getByTitle(/Save as CSV: every metric/));
    assert.equal(name, "brume_smoke_4spp_medium.csv");
    const [head, ...rows] = bytes
      .toString()
      .trimEnd()
      .split("\r\n")
      .map((line) => line.split(","));
    assert.deepEqual(rows.map((r) => r[3]).sort(), [
      "bilateral_searched",
      "gradient_kernel_searched",
      "nl_means_searched",
      "transport_regression_searched",
    ]);
    const cell = (method: string, column: string) => rows.find((r) => r[3] === method)![head!.indexOf(column)];
    const row = results.rows.find(
      (r) => r.scene === "smoke" && r.spp === 4 && r.region === "medium" && r.method === "bilateral_searched",
    )!;
    assert.equal(cell("bilateral_searched", "lab_rms"), String(row.metrics["lab_rms"]!.mean));
    assert.equal(cell("bilateral_searched", "peak_memory_bytes"), String(row.peak_memory_bytes));
    assert.equal(cell("nl_means_searched", "failed"), "a layer that it needs is missing");
    await context.close();
  });

  test("plots are saved as CSV, SVG and PNG", async () => {
    const context = await reader();
    const page = await open(context, made, "tab=plots&region=frame&hidden=nl_means_searched");
    const plot = page.locator(".plot").first();
    const svg = await saved(page, plot.getByRole("button", { name: "SVG" }));
    assert.equal(svg.name, "brume_cloud_lab_rms_frame_seconds.svg");
    const text = svg.bytes.toString();
    const methods = [...text.matchAll(/data-method="([^"]*)"/g)].map((m) => m[1]);
    assert.deepEqual(methods.sort(), [
      "bilateral_searched",
      "gradient_kernel_searched",
      "noisy",
      "transport_regression_searched",
    ]);
    assert.equal([...text.matchAll(/class="front"/g)].length, 2);
    const png = await saved(page, plot.getByRole("button", { name: "PNG" }));
    assert.deepEqual([png.bytes.readUInt32BE(16), png.bytes.readUInt32BE(20)], [1720, 1040], "twice its size");
    writeFileSync(join(shots, "saved_plot.png"), png.bytes);
    const table = await saved(page, plot.getByRole("button", { name: "CSV" }));
    const lines = table.bytes.toString().trimEnd().split("\r\n");
    assert.equal(lines.length, 1 + 4 * 2);
    assert.equal(lines.filter((l) => l.endsWith(",yes")).length, 2);
    await context.close();
  });

  test("pictures are saved pixel for pixel, with their names", async () => {
    const context = await reader();
    const page = await open(context, made);
    await drawn(page.locator(".stage canvas"));
    const { name, bytes } = await saved(page, page.locator(".zooms").getByRole("button", { name: "PNG" }));
    assert.equal(name, "brume_cloud_4spp.png");
    // Two pictures of 40 x 30, six times as large.
    assert.deepEqual([bytes.readUInt32BE(16), bytes.readUInt32BE(20)], [3 * 12 + 2 * 240, 2 * 12 + 180 + 40]);
    writeFileSync(join(shots, "saved_pictures.png"), bytes);
    await context.close();
  });
});

describe("A minus B", () => {
  test("is what the values say, and turns round with A and B", async () => {
    const context = await reader();
    const page = await open(context, made, "a=noisy&b=reference&zoom=4");
    const canvas = page.locator(".stage canvas");
    const picture = await drawn(canvas);
    await page.keyboard.press("g");
    await linkSays(page, "show", "difference");
    const difference = await drawn(canvas, picture);
    const box = (await canvas.boundingBox())!;
    await page.mouse.move(box.x + box.width / 2 + 1, box.y + box.height / 2 + 1);
    const cells = page.locator(".probe tr.minus td");
    await comesTo(() => cells.count(), 7);
    const read = async () => (await cells.allTextContents()).map((c) => Number(c.replace("−", "-").replace("+", "")));
    await comesTo(async () => (await read()).every(Number.isFinite), true);
    const [r, g, b, luminance, , signed] = await read();
    assert.ok(Math.abs(0.2126 * r! + 0.7152 * g! + 0.0722 * b! - luminance!) < 0.01 && luminance !== 0);
    assert.equal(signed, luminance, "the scene's exposure is 1");
    await page.keyboard.press("x");
    await comesTo(async () => (await read())[3], -luminance!);
    assert.notEqual(await drawn(canvas), difference);
    await page.keyboard.press("g");
    await linkSays(page, "show", null);
    await context.close();
  });

  test("in the grid is A minus each: nothing is left at A itself", async () => {
    const context = await reader();
    const page = await open(context, made, "mode=grid&show=difference&error=luminance&a=noisy");
    const centre = (method: string) => middleOf(page.locator(".tile", { hasText: method }).locator("canvas"));
    for (const canvas of await page.locator(".tile canvas").all()) await drawn(canvas);
    const none = await centre("A − path tracing");
    assert.ok(Math.max(...none.slice(0, 3)) < 40, `black where nothing differs: ${none}`);
    assert.notDeepEqual(await centre("A − reference"), none);
    await context.close();
  });
});

describe("keys that do nothing now", () => {
  const NOTHING: [hash: string, key: string, why: RegExp][] = [
    ["mode=flip", "ArrowLeft", /divider is of swipe/],
    ["split=1", "ArrowRight", /at the edge/],
    ["mode=grid", "ArrowRight", /divider is of swipe/],
    ["show=difference", "ArrowLeft", /no divider/],
    ["show=difference", " ", /one picture/],
    ["a=noisy&b=noisy", " ", /are the same/],
    ["a=noisy&b=noisy", "x", /are the same/],
    ["a=noisy&b=noisy", "g", /are the same/],
    ["a=reference", "r", /A is the reference/],
    ["a=reference&b=reference", "e", /no error/],
    ["show=error", "[", /does not change error maps/],
    ["tab=numbers", "]", /Exposure is of the pictures/],
    ["stops=12", "]", /12 stops/],
    ["", "\\", /scene's exposure/],
    ["show=error&gain=8", ">", /as long as it gets/],
    ["tab=plots", "+", /Zoom is of the pictures/],
    ["tab=plots", "0", /Zoom is of the pictures/],
    ["tab=plots", "w", /Zoom is of the pictures/],
    ["zoom=64", "+", /as close/],
    ["", "0", /All of the picture is seen/],
    ["", "d", /All of the picture is seen/],
    ["zoom=4&y=0.875", "s", /picture ends/],
    ["", ",", /4, 16 samples per pixel, no fewer/],
    ["spp=16", ".", /no more/],
    ["", "l", /This is look/],
    ["mode=grid", "3", /This is grid/],
  ];
  test("say why", async () => {
    const context = await reader();
    const page = await open(context, made);
    for (const [hash, key, why] of NOTHING) {
      await page.goto("about:blank");
      await page.goto(pathToFileURL(made).href + `#${hash}`);
      if (hash.includes("tab=")) await page.locator(".answer .one").first().waitFor();
      else await drawn(page.locator("canvas").first());
      assert.equal(await page.locator(".message").textContent(), "", hash);
      await page.keyboard.press(key);
      await comesTo(async () => why.test((await page.locator(".message").textContent())!), true, `${key} at ${hash}`);
    }
    await context.close();
  });

  test("say why of an evaluation that has one of everything", async () => {
    const single = join(folder, "single.html");
    const { results } = fixture();
    const few = {
      scenes: results.scenes.slice(0, 1),
      spp: [4],
      methods: results.methods,
      rows: results.rows.filter((r) => r.scene === "cloud" && r.spp === 4 && r.region === "frame"),
      metrics: results.metrics.slice(0, 1),
    };
    writeFileSync(
      single,
      readFileSync(made, "utf8").replace(/id="results">[^<]*</, () => `id="results">${JSON.stringify(few)}<`),
    );
    const context = await reader();
    const page = await open(context, single);
    for (const [key, why] of [
      ["m", /one scene/],
      ["f", /the whole frame only/],
      ["c", /one metric/],
      [".", /no more/],
      ["b", /No layer was left out/],
      ["v", /No parameter was varied/],
    ] as const) {
      await page.keyboard.press(key);
      await comesTo(async () => why.test((await page.locator(".message").textContent())!), true, key);
    }
    await context.close();
  });
});

describe("tables and plots", () => {
  test("a click on a column sorts by it, another the other way round", async () => {
    const context = await reader();
    const page = await open(context, made, "tab=numbers");
    const order = () =>
      page
        .locator(".metrics")
        .first()
        .locator("tbody tr")
        .evaluateAll((rows) => rows.map((r) => (r as HTMLElement).dataset["method"]));
    const best = [
      "transport_regression_searched",
      "nl_means_searched",
      "gradient_kernel_searched",
      "bilateral_searched",
      "noisy",
    ];
    await comesTo(order, best);
    await page.getByRole("button", { name: "PSNR" }).click();
    await comesTo(order, best);
    await page.getByRole("button", { name: "PSNR" }).click();
    await comesTo(order, [...best].reverse());
    await page.getByRole("button", { name: "Method" }).click();
    await comesTo(async () => (await order())[0], "bilateral_searched");
    await context.close();
  });

  test("methods that are left out leave tables and plots", async () => {
    const context = await reader();
    const page = await open(context, made, "tab=numbers");
    const rows = page.locator(".metrics").first().locator("tbody tr");
    await comesTo(() => rows.count(), 5);
    await page.getByRole("checkbox", { name: "nl_means" }).uncheck();
    await comesTo(() => rows.count(), 4);
    await page.keyboard.press("p");
    await comesTo(() => page.locator(".plot").first().locator(".key li").count(), 4);
    await context.close();
  });

  test("direct and indirect light stand by themselves where a method cleans them so", async () => {
    const context = await reader();
    const page = await open(context, made, "tab=numbers");
    const rows = page.locator(".lights tbody tr");
    await comesTo(() => rows.count(), 2);
    await comesTo(() => rows.locator("th").allTextContents(), ["bilateral", "path tracing"]);
    await context.close();
  });

  test("who beats whom follows the metric", async () => {
    const context = await reader();
    const page = await open(context, made, "tab=numbers");
    const title = page.getByRole("heading", { name: "Who beats whom" });
    await comesTo(() => title.textContent(), "Who beats whom: Lab RMS");
    await page.keyboard.press("c");
    await comesTo(() => title.textContent(), "Who beats whom: PSNR");
    await comesTo(async () => (await page.locator(".matrix td.win").count()) > 0, true);
    await page.keyboard.press("c");
    await comesTo(() => title.textContent(), "Who beats whom: Lab RMS");
    await context.close();
  });

  test("sequences are told by their temporal error, the best first", async () => {
    const context = await reader();
    const page = await open(context, made, "tab=numbers");
    const rows = page.locator(".sequence tbody tr");
    await comesTo(() => rows.count(), 2);
    await comesTo(
      () => rows.first().locator("td").allTextContents(),
      ["3", "0.250 ± 0.0100", "0.500 ± 0.0100", "−0.0100 ± 0.00100", "250 ms"],
    );
    await context.close();
  });

  test("what failed says so", async () => {
    const context = await reader();
    const page = await open(context, made, "tab=numbers&scene=smoke");
    assert.match(
      (await page.locator(".failures").textContent())!,
      /nl_means.*smoke, 4 spp: a layer that it needs is missing/,
    );
    await context.close();
  });

  test("a filter that is not brume's shows its command", async () => {
    const others = join(folder, "others.html");
    const { results } = fixture();
    const command = "python3 mine.py {frame} {output}";
    results.methods[1] = { ...results.methods[1]!, filter: "command", parameters: "", command };
    const json = JSON.stringify(results).replaceAll("<", "\\u003c"); // as the page has it
    writeFileSync(
      others,
      readFileSync(made, "utf8").replace(/id="results">[^<]*</, () => `id="results">${json}<`),
    );
    const context = await reader();
    const page = await open(context, others, "tab=about");
    const row = page.locator(`tr[data-method="${results.methods[1]!.id}"]`);
    await comesTo(() => row.locator("code.parameter").first().textContent(), command);
    await context.close();
  });

  test("a bare evaluation has no tabs without content", async () => {
    const bare = join(folder, "bare.html");
    const { results } = fixture();
    const few = {
      scenes: results.scenes,
      spp: results.spp,
      methods: results.methods,
      rows: results.rows,
      metrics: results.metrics,
    };
    writeFileSync(
      bare,
      readFileSync(made, "utf8").replace(/id="results">[^<]*</, () => `id="results">${JSON.stringify(few)}<`),
    );
    const context = await reader();
    const page = await open(context, bare, "tab=ablation");
    await comesTo(() => page.getByRole("tab").allTextContents(), ["Look", "Numbers", "Plots", "About"]);
    await drawn(page.locator(".stage canvas"));
    for (const key of ["n", "p", "i"]) await page.keyboard.press(key);
    await context.close();
  });
});

const VIEWS: Record<string, string> = {
  swipe: "",
  swipe_error: "show=error",
  flip: "mode=flip",
  grid: "mode=grid",
  grid_error: "mode=grid&show=error&error=luminance",
  difference: "show=difference&error=luminance",
  grid_difference: "mode=grid&show=difference&error=luminance",
  zoomed: "zoom=5&x=0.4&y=0.45",
  numbers: "tab=numbers",
  numbers_all: "tab=numbers&setting=&scene=smoke",
  plots: "tab=plots",
  ablation: "tab=ablation",
  sensitivity: "tab=sensitivity",
  about: "tab=about",
};

describe("every view", () => {
  for (const [device, viewport] of [
    ["desktop", DESKTOP],
    ["phone", PHONE],
  ] as const)
    for (const scheme of ["light", "dark"] as const)
      test(`is accessible and fits a ${device} in ${scheme} colours`, async () => {
        const context = await reader(viewport, scheme);
        const page = await open(context, made);
        const found: string[] = [];
        for (const [name, hash] of Object.entries(VIEWS)) {
          await load(page, made, hash);
          for (const canvas of await page.locator(".pane canvas").all()) await drawn(canvas);
          await page.screenshot({ path: join(shots, `${device}_${scheme}_${name}.png`), fullPage: true });
          const wide = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
          if (wide > 0) found.push(`${name} is ${wide} pixels wider than the ${device}`);
          // What depends on the size does not on the colours.
          if (device === "desktop" || scheme === "light") found.push(...(await violations(page, name)));
        }
        await load(page, made, "");
        await page.keyboard.press("?");
        await page.getByRole("dialog").waitFor({ state: "visible" });
        await page.screenshot({ path: join(shots, `${device}_${scheme}_help.png`) });
        found.push(...(await violations(page, "help")));
        await context.close();
        assert.deepEqual(found, []);
      });

  test("can be printed", async () => {
    const context = await reader({ width: 794, height: 1123 }, "dark");
    const page = await open(context, made);
    for (const name of ["swipe", "grid", "numbers", "plots", "about"]) {
      await page.emulateMedia({ media: null });
      await load(page, made, VIEWS[name]!);
      for (const canvas of await page.locator(".pane canvas").all()) await drawn(canvas);
      await page.emulateMedia({ media: "print" });
      await page.screenshot({ path: join(shots, `print_${name}.png`), fullPage: true });
      await page.locator(".methods").waitFor({ state: "hidden" });
      const ground = () => page.evaluate(() => getComputedStyle(document.documentElement).backgroundColor);
      await comesTo(ground, "rgb(255, 255, 255)");
    }
    await context.close();
  });

  test("said nothing to the console and asked no host", () => {
    assert.deepEqual(complaints, []);
  });
});
