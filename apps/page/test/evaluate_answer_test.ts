// The answer on top of the page of brume evaluate.
import assert from "node:assert/strict";
import test, { describe } from "node:test";
import { comesTo } from "./browser";
import { judgeWhatPagesSaid, linkSays, made, open, pageOf, reader, told } from "./evaluate_page";
import { fixture } from "./fixture";

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
    const { results } = fixture();
    for (const group of results.overall) {
      group.seeds = 1;
      group.methods = group.methods.filter((m) => m.method !== "nl_means_searched");
      if (group.setting === "searched") group.left_out = [{ method: "nl_means_searched", why: "failed on smoke" }];
    }
    const odd = pageOf("odd.html", results);
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
});

judgeWhatPagesSaid();
