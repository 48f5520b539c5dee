"""brume.render against the command line."""

import unittest

import numpy as np

import brume
from support import CLOUD, TEXT, TINY, Folder, run


class Render(Folder):
    def test_it_equals_the_command_line_to_the_bit(self):
        run("render", CLOUD, "--spp", "4", "--seed", "5", "-D", "film.width=32", "-D", "film.height=24",
            "-o", self.folder / "a.exr", "-q")
        expected, found = brume.read(self.folder / "a.exr"), brume.render(CLOUD, spp=4, seed=5, **TINY)
        self.assertEqual(found.keys(), expected.keys())
        for name in expected:
            np.testing.assert_array_equal(found[name], expected[name], name)

    def test_the_clean_picture_equals_the_command_lines(self):
        run("render", CLOUD, "--clean", "--spp", "4", "-D", "film.width=32", "-D", "film.height=24",
            "-o", self.folder / "a.exr", "-q")
        expected, found = brume.read(self.folder / "a.exr"), brume.render(CLOUD, spp=4, clean=True, **TINY)
        self.assertEqual(found.keys(), expected.keys())
        for name in expected:
            np.testing.assert_array_equal(found[name], expected[name], name)

    def test_a_text_is_a_scene(self):
        frame = brume.render(TEXT, spp=1, environment__radiance=[0.25, 0.5, 1.0])
        np.testing.assert_allclose(frame.image()[0, 0], [0.25, 0.5, 1.0], rtol=1e-6)

    def test_values_of_numpy_set_keys_of_the_scene(self):
        frame = brume.render(TEXT, spp=np.int64(1), environment__radiance=np.array([0.25, 0.5, 1.0]),
                             film__width=np.int32(9), camera__fov=np.float32(30))
        self.assertEqual(frame.shape, (12, 9))
        np.testing.assert_allclose(frame.image()[0, 0], [0.25, 0.5, 1.0], rtol=1e-6)

    def test_errors_have_the_words_of_the_command_line(self):
        with self.assertRaisesRegex(brume.InputError, "camera.*fov"):
            brume.render(TEXT, camera__fof=3)
        with self.assertRaisesRegex(brume.InputError, "crop .*inside"):
            brume.render(TEXT, crop=(0, 0, 99, 1))
        with self.assertRaisesRegex(brume.InputError, "nowhere.toml"):
            brume.render("nowhere.toml")
        with self.assertRaisesRegex(brume.InputError, "spp: expected 1"):
            brume.render(TEXT, spp=0)


if __name__ == "__main__":
    unittest.main()
