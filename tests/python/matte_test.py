"""Cryptomatte of frames in memory."""

import unittest

import numpy as np

import brume
from support import Folder

SMOKE = {
    "camera": {"position": [0, -7, 2], "look_at": [0, 0, 1], "fov": 34},
    "film": {"width": 32, "height": 24},
    "environment": {"radiance": 0.5},
    "volumes": [
        {"shape": "sphere", "lo": [-1, -1, 0], "hi": [1, 1, 2], "sigma_t": 1, "name": "Rök"},
        {"shape": "box", "lo": [0, 0, 0], "hi": [2, 2, 2], "sigma_t": 2},
    ],
}


class Mattes(Folder):
    def test_they_are_arrays_that_add_up_to_alpha(self):
        frame = brume.render(SMOKE, spp=2, layers=["direct", "indirect", "cryptomatte"])
        self.assertEqual(frame.mattes(), {"CryptoMaterial": ["volume"], "CryptoObject": ["Rök", "box"]})
        ball, box = frame.matte("Rök"), frame.matte("box")
        self.assertEqual((ball.shape, ball.dtype), ((24, 32), np.float32))
        self.assertGreater(ball.max(), 0.5)
        np.testing.assert_allclose(ball + box, frame["A"], atol=1e-6)
        np.testing.assert_allclose(frame.matte("Rök", "box"), frame["A"], atol=1e-6)
        np.testing.assert_allclose(frame.matte("*", layer="CryptoMaterial"), frame["A"], atol=1e-6)
        with self.assertRaisesRegex(brume.InputError, "no Cryptomatte has smoke"):
            frame.matte("smoke")
        with self.assertRaisesRegex(brume.InputError, "expected names"):
            frame.matte()
        with self.assertRaisesRegex(brume.InputError, "has no Cryptomatte"):
            brume.Layers({"R": np.zeros((2, 2), np.float32)}).matte("Rök")

    def test_cleaning_and_files_keep_them_bit_for_bit(self):
        frame = brume.render(SMOKE, spp=2, layers=["direct", "indirect", "cryptomatte"])
        clean = brume.denoise(frame, "gaussian")
        brume.write(self.folder / "f.exr", clean)
        for other in (clean, brume.read(self.folder / "f.exr")):
            self.assertEqual(other.mattes(), frame.mattes())
            np.testing.assert_array_equal(other.matte("Rök"), frame.matte("Rök"))
        self.assertTrue((clean.image() != frame.image()).any())


if __name__ == "__main__":
    unittest.main()
