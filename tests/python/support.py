"""What the tests of the Python package share."""

import os
import pathlib
import subprocess
import tempfile
import unittest

import numpy as np

import brume

PROGRAM = os.environ["BRUME_PROGRAM"]
SOURCE = pathlib.Path(os.environ["BRUME_SOURCE"])
CLOUD = SOURCE / "data/scenes/cloud.toml"
TINY = {"film__width": 32, "film__height": 24}

# A scene without volumes: a ball under a sky, which needs no file.
TEXT = """
[camera]
position = [0.0, -4.0, 0.0]
look_at = [0.0, 0.0, 0.0]
up = [0.0, 0.0, 1.0]
fov = 40.0
[film]
width = 16
height = 12
[environment]
radiance = [0.5, 0.75, 1.0]
"""


def run(*arguments):
    return subprocess.run([PROGRAM, *map(str, arguments)], capture_output=True, text=True, check=True).stdout


def random_frame(height=23, width=37):
    """A beauty and an indirect layer with variance and halves, drawn once."""
    rng = np.random.default_rng(3)
    arrays = {}
    for layer in ("beauty", "direct", "indirect"):
        mean = rng.random((height, width, 3), dtype=np.float32)
        noise = np.float32(0.1) * rng.standard_normal((height, width, 3), dtype=np.float32)
        prefix = "" if layer == "beauty" else layer + "."
        arrays[layer] = mean
        arrays[prefix + "half_a"] = mean + noise
        arrays[prefix + "half_b"] = mean - noise
        arrays[prefix + "mean_variance"] = noise * noise
    return brume.Layers(arrays)


class Folder(unittest.TestCase):
    def setUp(self):
        self._folder = tempfile.TemporaryDirectory()
        self.folder = pathlib.Path(self._folder.name)
        self.addCleanup(self._folder.cleanup)


def cloud_array(shape=(12, 14, 18)):
    """A density that is 0 in places, drawn once."""
    density = np.random.default_rng(5).random(shape, dtype=np.float32)
    return np.where(density > 0.4, density, np.float32(0))


# A scene of an array, in whose few voxels light is solved in no time.
SMALL = {"camera": {"position": [6.0, -30.0, 12.0], "look_at": [6.0, 5.0, 4.0], "fov": 40.0},
         "film": {"width": 24, "height": 16},
         "environment": {"radiance": [0.3, 0.4, 0.6]},
         "lights": [{"type": "sun", "direction": [-1.0, -1.0, 2.0], "irradiance": 3.0}]}


def small_scene(**volume):
    return {**SMALL, "volumes": [{"density": cloud_array(), "sigma_t": 0.6, "albedo": 0.95, **volume}]}


def assert_same_pixels(test, found, expected, what=""):
    """Every channel of two frames, to the bit."""
    test.assertEqual(found.keys(), expected.keys(), what)
    for name in expected:
        np.testing.assert_array_equal(found[name], expected[name], f"{what} {name}")
