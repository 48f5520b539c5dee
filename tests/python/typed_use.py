"""What a type checker sees of the package: every call has the type that is asserted, and what is marked is an error.

Not run: `mypy --strict --warn-unused-ignores` reads it (tests/python/CMakeLists.txt).
"""

import os
import pathlib
from collections.abc import Iterator
from typing import Any, assert_type

import numpy as np
import numpy.typing as npt

import brume

path = pathlib.Path("cloud.toml")
image = np.zeros((4, 4, 3))

scene = brume.Scene({"camera": {"fov": 30}, "volumes": [{"density": np.zeros((4, 4, 4))}]}, camera__fov=20)
assert_type(scene, brume.Scene)
assert_type(brume.Scene(path), brume.Scene)
assert_type(brume.Scene("cloud.toml"), brume.Scene)
assert_type(brume.Scene(scene), brume.Scene)
brume.Scene(3)  # type: ignore[arg-type]
assert_type(scene.render(spp=4, clean=True, camera__position=(0, 1, 2)), brume.Layers)
assert_type(scene.render(frames="1-4", output="a.####.exr"), dict[str, list[int]])
scene.render(frames="1-4")  # type: ignore[call-overload]
scene.render(spp="four")  # type: ignore[call-overload]
assert_type(scene.explain(clean="nfor"), str)
assert_type(scene.set(camera__fov=3), None)
assert_type(scene.settings, dict[str, Any])
assert_type(scene.counts, dict[str, int])
assert_type(scene.text, str)
assert_type(scene.copy(), brume.Scene)
assert_type(dict(scene), dict[str, Any])
assert_type(scene.keys(), list[str])
scene.counts = {}  # type: ignore[misc]

noisy = brume.render("cloud.toml", spp=4, seed=1, layers="direct,indirect", crop=(0, 0, 4, 4), part=(1, 2), time=3.5,
                     target_error=0.1, checkpoint=path, resume="state.exr")
assert_type(noisy, brume.Layers)
assert_type(brume.render({"camera": {}}, layers=["direct"]), brume.Layers)
assert_type(brume.render(scene, frames="1-4", output=path, resume=True), dict[str, list[int]])
brume.render(spp=4)  # type: ignore[call-overload]


def look(layers: brume.Layers, info: dict[str, Any]) -> None:
    print(layers["R"].max(), info["samples"])


def tell(fraction: float) -> None:
    print(fraction)


brume.render(path, on_picture=look, progress=tell)
brume.render(path, on_picture=tell)  # type: ignore[arg-type]

assert_type(noisy["R"], npt.NDArray[np.float32])
assert_type(noisy.image("direct"), npt.NDArray[np.float32])
assert_type(noisy.header, dict[str, Any])
assert_type(noisy.matte("smoke", "floor", layer="CryptoObject"), npt.NDArray[np.float32])
assert_type(noisy.mattes(), dict[str, list[str]])
noisy.matte(3)  # type: ignore[arg-type]
assert_type(noisy.shape, tuple[int, int])
assert_type(noisy.keys(), list[str])
assert_type(iter(noisy), Iterator[str])
assert_type(noisy.layers(), list[str])
assert_type(brume.Layers({"R": image[:, :, 0]}, header={"owner": "me", "n": 3}, like=noisy), brume.Layers)
noisy["R"] = 0.5
noisy.header = {"owner": "me"}
noisy.width = 3  # type: ignore[misc]

assert_type(brume.denoise(noisy), brume.Layers)
assert_type(brume.denoise(image, "gaussian", sigma=1), brume.Layers)
assert_type(brume.denoise(noisy, "nl_means", search_radius=7, guides=noisy), brume.Layers)
assert_type(brume.denoise({"R": image[:, :, 0]}, "nfor", preset="guides"), brume.Layers)
assert_type(brume.denoise("noisy.exr"), brume.Layers)
assert_type(brume.denoise([noisy, noisy], "transport_regression", guides=["a.exr", "b.exr"]), list[brume.Layers])
assert_type(brume.denoise("other.exr", output="clean.exr", suffix="_clean", samples=16), dict[str, list[int]] | None)
assert_type(brume.denoise(path, "bilateral", output=path, frame_numbers="1-4", radius=3), dict[str, list[int]] | None)
assert_type(brume.denoise(noisy, brume.filters()[0]["name"]), brume.Layers)
assert_type(brume.denoise(noisy, "welch", lambda_=0.5), brume.Layers)
brume.denoise(noisy, "nl_means", serch_radius=7)  # type: ignore[call-overload]
brume.denoise(noisy, "nl_means", sigma=7)  # type: ignore[call-overload]
brume.denoise(noisy, "nl_means", buffers="three")  # type: ignore[call-overload]
brume.denoise(noisy, radius=7)  # type: ignore[call-overload]
brume.denoise(noisy, tile="large")  # type: ignore[call-overload]
brume.denoise(3)  # type: ignore[call-overload]

assert_type(brume.guides(noisy, scene, samples=16), brume.Layers)
assert_type(brume.guides("noisy.exr", volume=path), brume.Layers)
assert_type(brume.merge([noisy, "part.exr"], mergeable=True), brume.Layers)
assert_type(brume.merge("part##.exr", numbers="1-4"), brume.Layers)
assert_type(brume.compare("a.exr", noisy, each_layer=True), dict[str, Any])
assert_type(brume.compare([noisy, "b.exr"], [image, image], frames="1-2"), dict[str, Any])
assert_type(brume.metrics(image, noisy, exposure="auto"), dict[str, Any])
assert_type(brume.read(os.fsencode("a.exr"), ["direct"]), brume.Layers)
assert_type(brume.write(path, {"beauty": image}), None)
assert_type(brume.filters(), list[dict[str, Any]])
assert_type(brume.view(path, frames="1-4", camera__fov=3), str)
assert_type(brume.__version__, str)

try:
    brume.read("missing.exr")
except brume.InputError as error:
    print(error)


def mine(frame: brume.Layers) -> npt.NDArray[np.float32]:
    return frame.image()


assert_type(brume.evaluate("quick.toml", {"mine": mine, "narrow": "gaussian:sigma=1"}, output="out"), dict[str, Any])
brume.evaluate([path], [mine, "bilateral"], spp=[4, 16], seeds=2, cache=path, search=False, camera__fov=30)
brume.evaluate(path, mine, spp=4)
brume.evaluate(path, {"mine": 3})  # type: ignore[dict-item]
brume.evaluate(path, tell)  # type: ignore[arg-type]
