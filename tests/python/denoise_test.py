"""brume.denoise against the command line."""

import logging
import unittest

import numpy as np

import brume
from support import CLOUD, TINY, Folder, random_frame, run


class Denoise(Folder):
    def test_it_equals_the_command_line_to_the_bit(self):
        noisy = brume.render(CLOUD, spp=4, **TINY)
        brume.write(self.folder / "noisy.exr", noisy)
        for words, keywords in (
            ([], {}),
            (["-f", "nl_means", "--search-radius", "4"], {"filter": "nl_means", "search_radius": 4}),
            (["-f", "bilateral", "--preset", "paper"], {"filter": "bilateral", "preset": "paper"}),
            (["-f", "gaussian", "--component", "indirect"], {"filter": "gaussian", "component": "indirect"}),
        ):
            run("denoise", self.folder / "noisy.exr", "-o", self.folder / "clean.exr", "-q", *words)
            expected, found = brume.read(self.folder / "clean.exr"), brume.denoise(noisy, **keywords)
            self.assertEqual(found.keys(), expected.keys(), words)
            for name in expected:
                np.testing.assert_array_equal(found[name], expected[name], str(words))
            self.assertEqual(found.header["filter"], expected.header["filter"])

    def test_layers_and_their_copy_as_arrays_give_the_same(self):
        frame = random_frame()
        plain = {name: np.array(view) for name, view in frame.items()}
        np.testing.assert_array_equal(brume.denoise(frame, "nl_means").image(), brume.denoise(plain, "nl_means").image())

    def test_the_input_is_left_alone(self):
        frame = random_frame()
        before = frame.copy()
        brume.denoise(frame, "bilateral")
        for name in before:
            np.testing.assert_array_equal(frame[name], before[name])

    def test_a_picture_that_is_clean_already_is_cleaned_from_its_noisy_layer(self):
        clean = brume.render(CLOUD, spp=4, clean="gaussian", **TINY)
        raw = brume.render(CLOUD, spp=4, layers="direct,indirect", **TINY)
        np.testing.assert_array_equal(clean.image("noisy"), raw.image())
        with self.assertLogs("brume", logging.WARNING) as told:
            again = brume.denoise(clean, "gaussian")
        self.assertIn("the frame is clean already", told.output[0])
        np.testing.assert_array_equal(again.image(), brume.denoise(raw, "gaussian").image())

    def test_errors_have_the_words_of_the_command_line(self):
        frame = random_frame()
        for keywords, words in (
            ({"filter": "nl_mean"}, "nl_mean.*did you mean.*nl_means"),
            ({"filter": "nl_means", "search_radius": 4000}, "search-radius"),
            ({"filter": "nl_means", "sarch_radius": 4}, "sarch-radius.*search-radius"),
            ({"search_radius": 4}, "search_radius: a parameter without a filter"),
            ({"component": "some"}, "component 'some': expected one of all, indirect, separate"),
            ({"exposure": -1}, "exposure: expected header, auto or a number above 0, found -1"),
            ({"filter": "sbf"}, "."),
        ):
            with self.assertRaisesRegex(brume.InputError, words):
                brume.denoise({"R": frame["R"]} if keywords == {"filter": "sbf"} else frame, **keywords)
        with self.assertRaisesRegex(brume.InputError, "the layers before it have 23 x 37"):
            brume.denoise({"R": frame["R"], "G": np.zeros((2, 2))})
        with self.assertRaisesRegex(brume.InputError, "a.exr: no such file"):
            brume.denoise("a.exr")
        with self.assertRaisesRegex(TypeError, r"layers\['beauty'\]: expected real numbers, found object"):
            brume.denoise(object())
        self.assertTrue(issubclass(brume.InputError, ValueError))


if __name__ == "__main__":
    unittest.main()
