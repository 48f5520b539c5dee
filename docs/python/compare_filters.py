"""A notebook-style script: how the filters do on one frame, as a figure with matplotlib.

Each cell begins with `# %%`, as Jupyter, VS Code and Spyder read it. As a script:
compare_filters.py [--size PIXELS] [--folder FOLDER] writes compare_filters.png.
"""

# %% Packages. Without matplotlib there is nothing to draw: the script says so and ends with status 77.
import argparse
import pathlib
import sys

import numpy as np

import brume

try:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
except ImportError:
    print("skipped: matplotlib is missing (apt-get install python3-matplotlib)")
    sys.exit(77)

arguments = argparse.ArgumentParser(description=__doc__.split("\n")[0])
arguments.add_argument("--size", type=int, default=192, help="side of the pictures [px]")
arguments.add_argument("--folder", type=pathlib.Path, default=pathlib.Path("."), help="where to write")
options, _ = arguments.parse_known_args()

# %% A smoke at 8 samples per pixel, and a reference.
scene = pathlib.Path(__file__).parents[2] / "data/scenes/smoke.toml"
film = {"film__width": options.size, "film__height": options.size}
noisy = brume.render(scene, spp=8, buckets=True, layers="all", **film)
reference = brume.render(scene, spp=256, seed=7, layers="direct,indirect,coverage", **film)

# %% The six filters of the highest merit that this frame has the layers for.
results = {"noisy": noisy}
for entry in brume.filters():
    if len(results) == 7:
        break
    try:
        results[entry["name"]] = brume.denoise(noisy, entry["name"])
    except brume.InputError as missing:
        print(f"{entry['name']}: {missing}")

# %% Channels are arrays: what follows is plain NumPy.
def shown(frame):
    """As a display shows it: exposure, then the curve of sRGB."""
    light = np.clip(frame.image() * reference.header.get("exposure", 1.0), 0, 1)
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


figure, axes = plt.subplots(2, 4, figsize=(13, 7), constrained_layout=True)
for axis, (name, frame) in zip(axes.flat, {**results, "reference": reference}.items()):
    axis.imshow(shown(frame))
    axis.set_title(f"{name}\nLab RMS {brume.metrics(frame, reference)['lab_rms']:.3f}", fontsize=9)
for axis in axes.flat:
    axis.axis("off")
figure.savefig(options.folder / "compare_filters.png", dpi=100)
print(options.folder / "compare_filters.png")
