#!/usr/bin/env python3
"""What each filter gains from which features: Lab RMS over the medium, as one Markdown table per scene.

    PYTHONPATH=build/python /usr/bin/python3 bench/ablation.py [SCENE.toml ...] [--size 128] [--spp 16] [--seeds 2]

Every filter that takes features runs with none, with those that a surface denoiser knows (opacity, albedo, normal, depth),
with those that a volume renderer records as well (density gradient, depth of the first scattering, single scattering), with
the noise-free guides alone, and with all of them. A filter that takes no features has one number, over what it declares.
"""

import argparse
import logging
import pathlib

import brume
import numpy as np

ROOT = pathlib.Path(__file__).resolve().parent.parent
SCENES = ["data/scenes/cloud", "data/scenes/smoke", "bench/scenes/forward_cloud", "bench/scenes/coloured_smoke",
          "data/scenes/fire", "bench/scenes/solid_smoke"]
LAYERS = ("direct,indirect,emission,surface,background,gradient,gradient_transmittance_weighted,coverage,transmittance,"
          "optical_depth,albedo,normal,depth,scatter_depth,scatter_share,single,flash,guides")
SURFACE = ["opacity", "albedo", "normal", "surface-depth"]
VOLUME = SURFACE + ["gradient", "scatter-depth", "single"]
SETS = {"none": ["none"], "surfaces'": SURFACE, "volumes'": VOLUME, "guides": ["guides"], "all": VOLUME + ["guides"]}


def geometric_mean(values):
    return float(np.exp(np.mean(np.log(values))))


def error(frames, references, clean):
    """Geometric mean over frames; the products of two references' errors are free of the references' noise."""
    return geometric_mean([brume.metrics(clean(f), *references)["medium"]["lab_rms"] for f in frames])


def without_guides(frame):
    return brume.Layers({c: frame[c] for c in frame if not c.startswith("guide.")}, like=frame)


def cells(frames, references, name, inputs):
    """One for each set of features."""
    def clean(frame, **parameters):
        return brume.denoise(frame, name, **parameters)

    if name == "transport_regression":  # reads the guides and what else it knows by itself
        bare = error(frames, references, lambda f: clean(without_guides(f)))
        return ["", "", bare, "", error(frames, references, clean)]
    if not any("features" in line for line in inputs):
        return [error(frames, references, clean)] + [""] * (len(SETS) - 1)
    strength = {"feature_strength": 1.0} if name == "nl_means" else {}  # which looks at colours alone by default
    return ["" if features == ["none"] and "needs: features" in inputs else
            error(frames, references, lambda f: clean(f, features=features, **strength)) for features in SETS.values()]


def row(frames, references, entry):
    values = cells(frames, references, entry["name"], entry["inputs_and_outputs"])
    return f"| {entry['name']} | " + " | ".join(v if v == "" else f"{v:.3f}" for v in values) + " |"


def main():
    logging.getLogger("brume").setLevel(logging.ERROR)  # which features a frame lacks is known here
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=[str(ROOT / f"{s}.toml") for s in SCENES])
    parser.add_argument("--size", type=int, default=128)
    parser.add_argument("--spp", type=int, default=16)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--reference-spp", type=int, default=768)
    options = parser.parse_args()
    filters = [f for f in brume.filters() if not any("needs: the record" in line for line in f["inputs_and_outputs"])]
    for scene in options.scenes:
        size = {"film__width": options.size, "film__height": options.size}
        references = [brume.render(scene, spp=options.reference_spp, seed=seed, layers="coverage", statistics=False, **size)
                      for seed in (101, 102)]
        frames = [brume.render(scene, spp=options.spp, seed=seed, layers=LAYERS, buckets=True, **size)
                  for seed in range(1, options.seeds + 1)]
        noisy = error(frames, references, lambda f: f)
        print(f"\n### {pathlib.Path(scene).stem}, {options.spp} spp: {noisy:.3f} before filtering\n")
        print("| filter | " + " | ".join(SETS) + " |\n|---|" + "---:|" * len(SETS), flush=True)
        for entry in filters:
            print(row(frames, references, entry), flush=True)


if __name__ == "__main__":
    main()
