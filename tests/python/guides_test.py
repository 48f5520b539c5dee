"""brume.guides against the command line."""

import unittest

import numpy as np

import brume
from support import CLOUD, SOURCE, TINY, Folder, assert_same_pixels, cloud_array, run, small_scene

VOLUME = SOURCE / "data/volumes/smoke.vdb"


class Guides(Folder):
    def setUp(self):
        super().setUp()
        self.frame = brume.render(CLOUD, spp=4, **TINY)
        self.path = self.folder / "frame.exr"
        brume.write(self.path, self.frame)

    def assert_same_guides(self, found, expected):
        assert_same_pixels(self, found, expected)
        for key in ("scene", "guidesFingerprint", "sceneHash"):
            self.assertEqual(found.header.get(key), expected.header.get(key), key)

    def test_they_equal_the_command_lines_to_the_bit(self):
        run("guides", "--like", self.path, "--scene", CLOUD, "-o", self.folder / "g.exr", "-q")
        expected = brume.read(self.folder / "g.exr")
        self.assertTrue(all(name.startswith("guide.") for name in expected))
        self.assert_same_guides(brume.guides(self.path, CLOUD), expected)
        run("guides", "--like", self.path, "--volume", VOLUME, "--spp", "64", "-D", "volumes.0.g=0.3",
            "-o", self.folder / "v.exr", "-q")
        self.assert_same_guides(brume.guides(self.path, volume=VOLUME, samples=64, volumes__0__g=0.3),
                                brume.read(self.folder / "v.exr"))

    def test_a_frame_in_memory_gives_its_camera_as_its_file_does(self):
        # The camera of the header, not that of the scene.
        scene = small_scene()
        frame = brume.render(scene, spp=1, camera__fov=20, crop=(4, 2, 20, 14))
        brume.write(self.folder / "crop.exr", frame)
        expected = brume.guides(self.folder / "crop.exr", scene)
        found = brume.guides(frame, scene)
        self.assertEqual((found.data_window, found.display_window), (frame.data_window, frame.display_window))
        assert_same_pixels(self, found, expected)
        other = brume.guides(brume.render(scene, spp=1), scene)["guide.opacity.Y"][2:14, 4:20]
        self.assertFalse(np.array_equal(found["guide.opacity.Y"], other))

    def test_a_scene_solves_its_light_once_for_all_frames(self):
        scene = brume.Scene(small_scene())
        for fov in (20, 30, 40):
            frame = brume.render(small_scene(), spp=4, camera__fov=fov)
            assert_same_pixels(self, brume.guides(frame, scene), brume.guides(frame, small_scene()))
        self.assertEqual(scene.counts["lights_solved"], 1)

    def test_they_clean_a_frame(self):
        scene = small_scene()
        noisy, reference = brume.render(scene, spp=8), brume.render(scene, spp=512, seed=3)
        guides = brume.guides(noisy, scene)
        clean = brume.denoise(noisy, guides=guides)
        self.assertEqual(clean.header["filter"], "transport_regression")
        self.assertLess(brume.metrics(clean, reference)["lab_rms"], 0.6 * brume.metrics(noisy, reference)["lab_rms"])

    def test_output_is_written_too(self):
        found = brume.guides(self.frame, CLOUD, output=self.folder / "out.exr")
        assert_same_pixels(self, brume.read(self.folder / "out.exr"), found)

    def test_what_is_missing_is_said(self):
        bare = brume.Layers(dict(self.frame.items()))
        for arguments, words in (
            ({}, "neither a volume nor a scene"),
            ({"volume": VOLUME, "like": bare}, "the frame: no camera in its header"),
            ({"scene": {**dict(brume.Scene(CLOUD)), "volumes": []}}, "nothing in it scatters or glows"),
            ({"scene": CLOUD, "samples": 0}, "samples: expected 1 .. "),
            ({"volume": VOLUME, "volumes__0__density": cloud_array()}, "arrays: expected a scene"),
            ({"scene": CLOUD, "film__width": 400}, "the film has 400 x 24; expected a film of the same shape"),
            ({"scene": CLOUD, "output": self.folder / "no/where.exr"}, "no"),
        ):
            with self.assertRaisesRegex(brume.InputError, words):
                brume.guides(arguments.pop("like", self.frame), **arguments)


if __name__ == "__main__":
    unittest.main()
