// The page that brume evaluate writes: methods, numbers and pictures are those of the run.
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import test, { describe } from "node:test";
import { fromBase64, inflate, unpredict } from "../src/half";
import { errorMap } from "../src/library";
import { Picture } from "../src/picture";
import type { PictureEntry, Results } from "../src/results";
import { comesTo } from "./browser";
import { brume, evaluation, judgeWhatPagesSaid, load, open, reader, told } from "./evaluate_page";

const evaluated = evaluation();

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

judgeWhatPagesSaid();
