"""brume.metrics against the command line."""

import json
import unittest

import numpy as np

import brume
from support import CLOUD, TINY, Folder, run


class Metrics(Folder):
    def test_they_equal_the_command_lines(self):
        a, b = brume.render(CLOUD, spp=2, **TINY), brume.render(CLOUD, spp=4, seed=3, **TINY)
        brume.write(self.folder / "a.exr", a)
        brume.write(self.folder / "b.exr", b)
        told = json.loads(run("compare", self.folder / "a.exr", self.folder / "b.exr", "--json", "-q"))
        self.assertEqual(brume.metrics(a, b), {**told["metrics"], "medium": told["medium"]})

    def test_compare_has_all_that_the_command_line_reports(self):
        a, b, c = (brume.render(CLOUD, spp=n, seed=n, **TINY) for n in (2, 4, 8))
        for name, frame in (("a", a), ("b", b), ("c", c)):
            brume.write(self.folder / f"{name}.exr", frame)
        files = [self.folder / f"{name}.exr" for name in "abc"]
        for words, keywords in (
            ([], {}),
            (["--each-layer"], {"each_layer": True}),
            (["--layer", "indirect", "--exposure", "2.5", "--no-clip"], {"layer": "indirect", "exposure": 2.5, "clip": False}),
            (["--second-reference", files[2], "--exposure", "auto"], {"second": True, "exposure": "auto"}),
        ):
            told = json.loads(run("compare", files[0], files[1], "--json", "-q", *words))
            for x, r, r2 in ((*files,), (a, b, c)):
                given = {**keywords, "second": r2} if "second" in keywords else keywords
                found = brume.compare(x, r, **given)
                named = {"picture": str(files[0]), "reference": str(files[1])}
                self.assertEqual({**found, **named, "window": list(found["window"])}, told, words)
        self.assertEqual(brume.compare(a, b)["picture"], "picture")
        self.assertEqual(set(brume.compare(a, b, each_layer=True)["layers"]) & {"direct", "indirect"}, {"direct", "indirect"})

    def test_a_picture_equals_itself(self):
        image = np.random.default_rng(1).random((9, 8, 3), dtype=np.float32)
        errors = brume.metrics(image, image)
        self.assertEqual((errors["lab_rms"], errors["mse"], errors["pixels"]), (0, 0, 72))
        self.assertAlmostEqual(brume.metrics(image + np.float32(0.5), image)["mse"], 0.25, places=6)

    def test_other_sizes_are_refused(self):
        with self.assertRaisesRegex(brume.InputError, "picture is 3 x 2, reference is 2 x 2"):
            brume.metrics(np.zeros((2, 3, 3)), np.zeros((2, 2, 3)))


if __name__ == "__main__":
    unittest.main()
