#!/usr/bin/env python3
"""Prints the section of docs/results.md about six media from the results.json of bench/experiments/results.toml.

  brume evaluate bench/experiments/results.toml --cache build/cache -o build/results
  bench/results_section.py build/results/results.json
"""
import json
import math
import sys

OURS = "transport_regression"
TITLES = {"cloud": "dense cloud", "smoke": "thin smoke", "fire": "fire", "forward_cloud": "g = 0.85 cloud",
          "coloured_smoke": "coloured smoke", "solid_smoke": "smoke around a solid"}


def main():
    results = json.load(open(sys.argv[1]))
    methods = {m["id"]: m for m in results["methods"]}
    rows = {(r["scene"], r["spp"], r["method"], r["region"]): r for r in results["rows"]}
    scenes = [s["name"] for s in results["scenes"]]
    counts = results["spp"]
    shown = [m for m in methods.values() if m["setting"] in ("none", "default")]

    def metric(scene, spp, method, region="medium", name="lab_rms"):
        row = rows[scene, spp, method["id"], region]
        return None if "failed" in row else row["metrics"].get(name)

    def mean(*at, **more):
        value = metric(*at, **more)
        return value["mean"] if value else math.inf

    def best(scene, spp, wanted, region="medium"):
        return min((mean(scene, spp, m, region=region), m["label"]) for m in shown if wanted(m))

    ours = next(m for m in shown if m["filter"] == OURS)
    kernel = next(m for m in shown if m["label"] == "gradient_kernel")
    without = lambda m: m["filter"] and not m["guides"]
    given = lambda m: m["guides"] and m is not ours
    other = lambda m: m["filter"] and m is not ours

    for scene in scenes:
        print(f"| {TITLES.get(scene, scene)} | " + " | ".join(f"{n} spp" for n in counts) + " |")
        print("|---|" + "---:|" * len(counts))
        least = {n: min(mean(scene, n, m) for m in shown) for n in counts}
        for m in shown:
            cells = []
            for n in counts:
                value = metric(scene, n, m)
                if not value:
                    cells.append("–")
                    continue
                bold = "**" if value["mean"] == least[n] else ""
                cells.append(f"{bold}{value['mean']:.2f} ± {value['half_width']:.2f}{bold}")
            print(f"| {m['label']} | " + " | ".join(cells) + " |")
        print()

    def ratios(title, bound, region="medium"):
        print(f"| {title} | " + " | ".join(TITLES.get(s, s) for s in scenes) + " | mean |")
        print("|---|" + "---:|" * (len(scenes) + 1))
        for n in counts:
            values = [mean(s, n, ours, region=region) / bound(s, n, region) for s in scenes]
            product = math.exp(sum(map(math.log, values)) / len(values))
            print(f"| {n} spp | " + " | ".join(f"{v:.2f}" for v in values) + f" | **{product:.3f}** |")
        print()

    ratios("over the best without guides", lambda s, n, r: best(s, n, without, r)[0])
    ratios("over the best that was given guides", lambda s, n, r: best(s, n, given, r)[0])
    ratios("over gradient_kernel", lambda s, n, r: mean(s, n, kernel, region=r))
    ratios("whole frame, over the best other filter", lambda s, n, r: best(s, n, other, r)[0], region="frame")

    print("Best without guides, and with them:")
    for s in scenes:
        print(f"- {s}: " + "; ".join(f"{n} spp {best(s, n, without)[1]}, {best(s, n, given)[1]}" for n in counts))

    pairs = [p for p in results["pairs"] if p["region"] == "medium" and ours["id"] in (p["a"], p["b"])]
    wins = sum(p["better"] is not None and p[p["better"]] == ours["id"] for p in pairs)
    losses = sum(p["better"] is not None and p[p["better"]] != ours["id"] for p in pairs)
    print(f"\nOurs beats the other in {wins} of {len(pairs)} pairs over the medium, loses {losses}.")
    bias = [(abs(mean(s, n, ours, name="relative_bias")), s, n) for s in scenes for n in counts]
    print("Largest relative bias over the medium:", "; ".join(f"{100 * b:.2f} % ({s}, {n} spp)" for b, s, n in sorted(bias)[-4:]))


if __name__ == "__main__":
    main()
