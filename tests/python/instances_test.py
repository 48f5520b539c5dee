"""Places of instances, and times of sequences, as arrays: the same bits as from a table in a file; errors."""

import unittest

import numpy as np

import brume
from support import Folder, assert_same_pixels, cloud_array, run

BASE = {"camera": {"position": [0.0, -9.0, 1.0], "look_at": [0.0, 0.0, 0.0], "fov": 40.0},
        "film": {"width": 32, "height": 24},
        "environment": {"radiance": [0.5, 0.6, 0.7]},
        "lights": [{"type": "sun", "direction": [1.0, -1.0, 2.0], "irradiance": 3.0}]}


def places(count=5):
    rng = np.random.default_rng(4)
    matrices = np.tile(np.eye(4), (count, 1, 1))
    for i, m in enumerate(matrices):
        m[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0] * (0.5 + 0.1 * i)
        m[:3, 3] = rng.uniform(-2, 2, 3)
    return matrices, rng.uniform(0.5, 2, count), rng.uniform(0.5, 1, (count, 3))


def write_table(path, matrices, **columns):
    names = [f"m{row}{column}" for row in range(3) for column in range(4)] + list(columns)
    rows = [[*m[:3].ravel(), *(values[i] for values in columns.values())] for i, m in enumerate(matrices)]
    path.write_text("\n".join([",".join(names)] + [",".join(repr(float(v)) for v in row) for row in rows]) + "\n")


class Instances(Folder):
    def volume(self, **more):
        return {"density": cloud_array(), "voxel_size": 0.08, "origin": [-0.6, -0.6, -0.6], "sigma_t": 4.0, "albedo": 0.9, **more}

    def test_arrays_are_a_table(self):
        matrices, densities, tints = places()
        write_table(self.folder / "places.csv", matrices, density=densities, tint_r=tints[:, 0], tint_g=tints[:, 1], tint_b=tints[:, 2])
        scene = {**BASE, "volumes": [self.volume()]}
        arrays = brume.render({**scene, "instances": [{"volume": 0, "matrices": matrices, "densities": densities, "tints": tints}]}, spp=4)
        table = brume.render({**scene, "instances": [{"volume": 0, "file": str(self.folder / "places.csv")}]}, spp=4)
        assert_same_pixels(self, arrays, table)
        one = brume.render({**scene, "instances": [{"volume": 0, "matrices": matrices[:1]}]}, spp=4)
        self.assertGreater(np.abs(np.asarray(one["A"]) - np.asarray(arrays["A"])).max(), 0.1)

    def test_wrong_arrays_are_named(self):
        matrices, densities, tints = places()
        for entry, words in (
            ({"matrices": matrices[:, :3]}, ("instances.0", "4 x 4")),
            ({"matrices": matrices, "densities": densities[:2]}, ("instances.0", "densities")),
            ({"matrices": matrices, "tints": -tints}, ("instances.0", "tints")),
            ({"matrices": matrices * np.array([1, 1, 1, 0])[:, None] * 0}, ("instances.0",)),
            ({"matrices": matrices, "time_offsets": np.arange(5.0)}, ("instances.0", "time")),
        ):
            with self.assertRaises(brume.InputError) as caught:
                brume.render({**BASE, "volumes": [self.volume()], "instances": [{"volume": 0, **entry}]}, spp=1)
            for word in words:
                self.assertIn(word, str(caught.exception))


class Times(Folder):
    def test_a_curve_and_offsets_are_arrays(self):
        for frame in range(4):
            self.write_frame(frame)
        curve = np.array([[0, 0], [10, 3.0]])
        volume = {"file": str(self.folder / "puff.####.vdb"), "sigma_t": 4.0, "time": {"frame": curve, "between": "blend"}}
        scene = {**BASE, "volumes": [volume]}
        at_five = brume.render(scene, spp=4, render__frame=5, render__noise_frame=0)
        listed = {**BASE, "volumes": [{**volume, "time": {"frame": curve.tolist(), "between": "blend"}}]}
        assert_same_pixels(self, at_five, brume.render(listed, spp=4, render__frame=5, render__noise_frame=0))
        matrices = np.tile(np.eye(4), (2, 1, 1))
        matrices[:, 0, 3] = -1, 1
        placed = {"volume": 0, "matrices": matrices}
        still = {**volume, "time": {"offset": 0, "beyond": "hold"}}
        offsets = brume.render({**BASE, "volumes": [still], "instances": [{**placed, "time_offsets": np.array([0, 3.0])}]}, spp=4)
        write_table(self.folder / "places.csv", matrices, time_offset=np.array([0, 3.0]))
        table = brume.render({**BASE, "volumes": [still], "instances": [{"volume": 0, "file": str(self.folder / "places.csv")}]}, spp=4)
        assert_same_pixels(self, offsets, table)
        same = brume.render({**BASE, "volumes": [still], "instances": [placed]}, spp=4)
        self.assertGreater(np.abs(np.asarray(same["A"]) - np.asarray(offsets["A"])).max(), 0.1)

    def write_frame(self, frame):
        """Each frame another cloud."""
        run("generate", "cloud", "--resolution", 24, "--seed", frame, "-o", self.folder / f"puff.{frame:04d}.vdb", "-q")


if __name__ == "__main__":
    unittest.main()
