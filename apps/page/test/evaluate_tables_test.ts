// Tables and plots: what they list, what is saved of them.
import assert from "node:assert/strict";
import { readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import test, { describe } from "node:test";
import type { Locator, Page } from "playwright-core";
import { comesTo, drawn } from "./browser";
import { PHONE, folder, judgeWhatPagesSaid, made, open, pageOf, reader } from "./evaluate_page";
import { fixture } from "./fixture";

/** What a click saves. */
async function saved(page: Page, button: Locator): Promise<{ name: string; bytes: Buffer }> {
  const [download] = await Promise.all([page.waitForEvent("download"), button.click()]);
  return { name: download.suggestedFilename(), bytes: readFileSync((await download.path())!) };
}

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
    writeFileSync(join(folder, "saved_plot.png"), png.bytes);
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
    writeFileSync(join(folder, "saved_pictures.png"), bytes);
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
    const { results } = fixture();
    const command = "python3 mine.py {frame} {output}";
    results.methods[1] = { ...results.methods[1]!, filter: "command", parameters: "", command };
    const others = pageOf("others.html", results);
    const context = await reader();
    const page = await open(context, others, "tab=about");
    const row = page.locator(`tr[data-method="${results.methods[1]!.id}"]`);
    await comesTo(() => row.locator("code.parameter").first().textContent(), command);
    await context.close();
  });

  test("a bare evaluation has no tabs without content", async () => {
    const { results } = fixture();
    const few = {
      scenes: results.scenes,
      spp: results.spp,
      methods: results.methods,
      rows: results.rows,
      metrics: results.metrics,
    };
    const bare = pageOf("bare.html", few);
    const context = await reader();
    const page = await open(context, bare, "tab=ablation");
    await comesTo(() => page.getByRole("tab").allTextContents(), ["Look", "Numbers", "Plots", "About"]);
    await drawn(page.locator(".stage canvas"));
    for (const key of ["n", "p", "i"]) await page.keyboard.press(key);
    await context.close();
  });
});

judgeWhatPagesSaid();
