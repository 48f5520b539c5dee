"""Cleans a frame in three ways and says how far each is from a reference.

usage: clean_a_frame.py [--size PIXELS] [--folder FOLDER]

Renders the cloud of data/scenes at 8 samples per pixel, cleans it with the filter that brume recommends, with one that
is named, and while it is rendered, and writes the best as an EXR.
"""

import argparse
import pathlib

import brume

arguments = argparse.ArgumentParser(description=__doc__.split("\n")[0])
arguments.add_argument("--size", type=int, default=256, help="side of the picture [px]")
arguments.add_argument("--folder", type=pathlib.Path, default=pathlib.Path("."), help="where to write")
options = arguments.parse_args()
scene = pathlib.Path(__file__).parents[2] / "data/scenes/cloud.toml"
film = {"film__width": options.size, "film__height": options.size}

# What the clean pictures should be: many more samples of another seed.
reference = brume.render(scene, spp=256, seed=7, **film)

noisy = brume.render(scene, spp=8, **film)
pictures = {
    "noisy": noisy,
    "recommended filter": brume.denoise(noisy),
    "nl_means": brume.denoise(noisy, "nl_means", search_radius=5),
    "cleaned with guides": brume.render(scene, spp=8, clean=True, **film),
}
for name, picture in pictures.items():
    errors = brume.metrics(picture, reference)
    print(f"{name:<22} Lab RMS {errors['lab_rms']:.3f}, relative squared error {errors['rel_mse']:.5f}")

best = min(pictures, key=lambda name: brume.metrics(pictures[name], reference)["lab_rms"])
output = options.folder / "clean_a_frame.exr"
brume.write(output, pictures[best])
print(f"{output}: {best}, by {pictures[best].header.get('filter', 'no filter')}")
