#!/usr/bin/env python3
"""Prints a section of docs/results.md from the results.json of one of its experiments.

  brume evaluate bench/experiments/results.toml --cache build/cache -o build/results   # or papers, studies, scenes.toml
  bench/results_section.py build/results/results.json

Where parameters were searched: each filter by setting, and what the studies found. Otherwise: all filters on all media, and
transport_regression over the others; of scenes.toml, which has no gradient_kernel, one table over whole frames.
"""
import itertools
import json
import math
import sys

OURS = "transport_regression"
TITLES = {"cloud": "dense cloud", "smoke": "thin smoke", "fire": "fire", "forward_cloud": "g = 0.85 cloud",
          "coloured_smoke": "coloured smoke", "solid_smoke": "smoke around a solid"}


def table(columns, rows):
    """Numbers to the right, the least of each column bold; None is an empty cell."""
    print("| " + " | ".join(columns) + " |")
    print("|---|" + "---:|" * (len(columns) - 1))
    least = [min((row[i] for row in rows if isinstance(row[i], float)), default=None) for i in range(len(columns))]
    for row in rows:
        cells = ["" if v is None else v if isinstance(v, str) else f"**{v:.2f}**" if v == best else f"{v:.2f}"
                 for v, best in zip(row, least)]
        print("| " + " | ".join(cells) + " |")
    print()


def searched(results):
    """Each filter by setting, over the whole frame; its channels and parameters where they were studied."""
    settings = ["paper", "default", "searched", "transfer"]
    methods = {(m["label"], m["setting"]): m["id"] for m in results["methods"]}
    labels = list(dict.fromkeys(m["label"] for m in results["methods"]))
    means = {(r["scene"], r["spp"], r["method"]): r["metrics"]["lab_rms"]["mean"] for r in results["rows"]
             if r["region"] == "frame" and "lab_rms" in r["metrics"]}
    for scene in (s["name"] for s in results["scenes"]):
        print(f"### {scene.capitalize()}\n")
        rows = []
        for label in labels:
            setting = lambda s: methods.get((label, s)) or (methods.get((label, "none")) if s == "paper" else None)
            rows.append([label] + [means.get((scene, n, setting(s))) for n in results["spp"] for s in settings])
        table(["filter"] + [f"{n} {s}" for n in results["spp"] for s in settings], rows)
    if results["ablation"]:
        studied(results, means, "ablation", "layer", lambda r: (r["layer"], r["how"]))
    if results["sensitivity"]:
        studied(results, means, "sensitivity", "parameter", lambda r: (r["parameter"], r["value"]))


def studied(results, means, study, what, of):
    """Times the error of the filter as it is."""
    scenes = [s["name"] for s in results["scenes"]]
    labels = {m["id"]: m["label"] for m in results["methods"]}
    ratios = {}
    for r in results[study]:
        if r["region"] == "frame" and "lab_rms" in r["metrics"]:
            thing, value = of(r)
            ratio = r["metrics"]["lab_rms"]["mean"] / means[r["scene"], r["spp"], r["method"]]
            ratios.setdefault((labels[r["method"]], thing), {})[r["scene"], value] = ratio
    if study == "ablation":
        print("| filter | layer | " + " | ".join(f"{s}, without | {s}, alone" for s in scenes) + " |")
        print("|---|---|" + "---:|" * (2 * len(scenes)))
        for (label, layer), found in ratios.items():
            cells = [f"{found[s, how]:.2f}" if (s, how) in found else "" for s in scenes for how in ("without", "alone")]
            print(f"| {label} | {layer} | " + " | ".join(cells) + " |")
    else:
        print("| filter | parameter | " + " | ".join(scenes) + " |\n|---|---|" + "---|" * len(scenes))
        for (label, parameter), found in ratios.items():
            cells = []
            for scene in scenes:
                values = [(ratio, value) for (s, value), ratio in found.items() if s == scene]
                extremes = [min(values), max(values)] if values else []
                cells.append(", ".join(f"{ratio:.2f} at {value}" for ratio, value in dict.fromkeys(extremes)))
            print(f"| {label} | {parameter} | " + " | ".join(cells) + " |")
    print()


def clean_frames(results):
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
    for label in ("oidn", "least_risk"):
        for m in shown:
            if m["label"] == label:
                ratios(f"over {label}", lambda s, n, r, m=m: mean(s, n, m, region=r))
    ratios("over gradient_kernel", lambda s, n, r: mean(s, n, kernel, region=r))
    ratios("whole frame, over the best other filter", lambda s, n, r: best(s, n, other, r)[0], region="frame")

    print("Best without guides, and with them:")
    for s in scenes:
        print(f"- {s}: " + "; ".join(f"{n} spp {best(s, n, without)[1]}, {best(s, n, given)[1]}" for n in counts))

    pairs = [("ab"[pair.index(ours["id"])], letter) for group in results["pairs"]
             if group["region"] == "medium" and group["metric"] == "lab_rms"
             for pair, letter in zip(itertools.combinations(group["methods"], 2), group["better"]) if ours["id"] in pair]
    wins = sum(own == letter for own, letter in pairs)
    losses = sum(letter not in (own, "-") for own, letter in pairs)
    print(f"\nOurs beats the other in {wins} of {len(pairs)} pairs over the medium, loses {losses}.")
    bias = [(abs(mean(s, n, ours, name="relative_bias")), s, n) for s in scenes for n in counts]
    print("Largest relative bias over the medium:", "; ".join(f"{100 * b:.2f} % ({s}, {n} spp)" for b, s, n in sorted(bias)[-4:]))


def whole_frames(results):
    """A line for each scene: path tracing, ours and the best other filter at each sample count, over the whole frame."""
    methods = {m["id"]: m for m in results["methods"] if m["setting"] in ("none", "default")}
    ours = next(m["id"] for m in methods.values() if m["filter"] == OURS)
    counts = results["spp"]
    ratios, without, learned = ({n: [] for n in counts} for _ in range(3))
    print("| scene | " + " | ".join(f"{n} spp: path tracing, ours, best other" for n in counts) + " |")
    print("|---|" + "---|" * len(counts))
    for scene in (s["name"] for s in results["scenes"]):
        cells = []
        for n in counts:
            rms = {r["method"]: r["metrics"]["lab_rms"]["mean"] for r in results["rows"]
                   if (r["scene"], r["spp"], r["region"]) == (scene, n, "frame") and r["method"] in methods and "lab_rms" in r["metrics"]}
            other = min((m for m in rms if m != ours and methods[m]["filter"]), key=rms.get)
            noisy = next(v for m, v in rms.items() if not methods[m]["filter"])
            ratios[n].append(rms[ours] / rms[other])
            without[n].append(rms[ours] / min(v for m, v in rms.items() if m != ours and methods[m]["filter"]
                                              and "guides" not in methods[m]["label"]))
            learned[n] += [rms[ours] / v for m, v in rms.items() if methods[m]["label"] == "oidn"]
            cells.append(f"{noisy:.2f}, {rms[ours]:.2f}, {rms[other]:.2f} {methods[other]['label']} ({ratios[n][-1]:.2f})")
        print(f"| {scene} | " + " | ".join(cells) + " |")
    for name, of in (("the best other", ratios), ("the best without guides", without), ("oidn", learned)):
        if not all(of.values()):
            continue
        means = [f"{math.exp(sum(map(math.log, r)) / len(r)):.2f}" for r in of.values()]
        print(f"| geometric mean of ours over {name} | " + " | ".join(means) + " |")


def main():
    with open(sys.argv[1]) as file:
        results = json.load(file)
    if results["experiment"]["searched"]:
        searched(results)
    elif not any(m["filter"] == "gradient_kernel" for m in results["methods"]):
        whole_frames(results)
    else:
        clean_frames(results)


if __name__ == "__main__":
    main()
