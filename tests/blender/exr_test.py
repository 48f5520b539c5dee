"""The add-on's reader of EXRs against files that OpenEXR wrote, in Blender and in brume. Runs inside Blender."""

import os
import struct
import subprocess
import sys
import unittest

import bpy
import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import addon_scene as scenes  # noqa: E402
from addon_scene import exr  # noqa: E402

WIDTH, HEIGHT = 37, 29  # neither fills its last block


def written_by_blender(path, pixels, codec, depth):
    image = bpy.data.images.new("test", pixels.shape[1], pixels.shape[0], alpha=True, float_buffer=True)
    image.colorspace_settings.name = "Linear"
    image.pixels.foreach_set(np.ascontiguousarray(pixels[::-1], np.float32).ravel())
    settings = bpy.context.scene.render.image_settings
    settings.file_format, settings.color_mode = "OPEN_EXR", "RGBA"
    settings.exr_codec, settings.color_depth = codec, depth
    bpy.context.scene.view_settings.view_transform = "Raw"
    image.save_render(path)
    bpy.data.images.remove(image)


class Reader(unittest.TestCase):
    def setUp(self):
        scenes.new_scene()
        self.folder = scenes.folder()
        self.addCleanup(self.folder.cleanup)

    def path(self, name):
        return os.path.join(self.folder.name, name)

    def test_every_packing_and_type_that_it_knows_gives_the_pixels(self):
        rng = np.random.default_rng(1)
        noise = rng.normal(size=(HEIGHT, WIDTH, 4)).astype(np.float32)
        smooth = np.linspace(0, 1, HEIGHT * WIDTH * 4, dtype=np.float32).reshape(HEIGHT, WIDTH, 4)
        for codec in ("NONE", "ZIP", "ZIPS"):
            for depth in ("16", "32"):
                for name, pixels in (("noise", noise), ("smooth", smooth)):
                    with self.subTest(codec=codec, depth=depth, pixels=name):
                        pixels[..., 3] = 1
                        written_by_blender(self.path("a.exr"), pixels, codec, depth)
                        read = exr.read(self.path("a.exr")).layer("", "RGBA")
                        expected = pixels.astype(np.float16).astype(np.float32) if depth == "16" else pixels
                        np.testing.assert_allclose(read, expected, rtol=1e-3 if depth == "16" else 1e-6, atol=1e-6)

    def test_reads_what_brume_writes(self):
        frame = self.path("frame.exr")
        scene = os.path.join(scenes.SOURCE, "data", "scenes", "smoke.toml")
        size = ["-D", f"film.width={WIDTH}", "-D", f"film.height={HEIGHT}"]
        program = os.environ["BRUME_PROGRAM"]
        subprocess.run([program, "render", scene, *size, "--spp", "2", "--crop", "5,3,30,20", "-q", "-o", frame], check=True)
        read = exr.read(frame)
        self.assertEqual((read.x, read.y, read.width, read.height), (5, 3, 25, 17))
        self.assertEqual(read.header["samplesPerPixel"], 2)
        self.assertEqual(read.header["worldToCamera"].shape, (4, 4))
        parts = read.layer("direct", "RGB") + read.layer("indirect", "RGB")
        np.testing.assert_allclose(read.layer("", "RGB"), parts, rtol=1e-6, atol=1e-7)
        self.assertGreater(parts.max(), 0.1)
        self.assertIsNone(read.layer("gradient", "RGB"))  # its channels are X Y Z
        self.assertEqual(list(exr.read(frame, lambda name: name == "A").channels), ["A"])
        told = subprocess.run([program, "compare", frame, frame], capture_output=True, text=True, check=True).stdout
        self.assertIn("rel_mse", told)

    def test_says_what_it_cannot_read(self):
        pixels = np.ones((HEIGHT, WIDTH, 4), np.float32)
        written_by_blender(self.path("piz.exr"), pixels, "PIZ", "32")
        written_by_blender(self.path("good.exr"), pixels, "ZIP", "32")
        with open(self.path("good.exr"), "rb") as file:
            data = file.read()
        broken = {
            "text.exr": b"text" * 10,
            "empty.exr": b"",
            "short.exr": data[: len(data) // 2],
            "head.exr": data[:40],
            "tiled.exr": data[:4] + struct.pack("<i", 2 | 0x200) + data[8:],
        }
        for name, content in broken.items():
            with open(self.path(name), "wb") as file:
                file.write(content)
        expected = {"piz.exr": "PIZ", "text.exr": "no EXR", "tiled.exr": "tiled", "absent.exr": "No such file"}
        for name in (*broken, "piz.exr", "absent.exr"):
            with self.subTest(name), self.assertRaises(exr.NotReadable) as raised:
                exr.read(self.path(name))
            self.assertIn(name, str(raised.exception))
            self.assertIn(expected.get(name, "damaged or not whole"), str(raised.exception))

    def test_damaged_bytes_are_an_error_or_pixels_and_nothing_else(self):
        rng = np.random.default_rng(2)
        written_by_blender(self.path("good.exr"), rng.random((HEIGHT, WIDTH, 4)).astype(np.float32), "ZIP", "32")
        with open(self.path("good.exr"), "rb") as file:
            data = bytearray(file.read())
        for _ in range(300):
            damaged = bytearray(data)
            for place in rng.integers(0, min(len(data), 800), 3):
                damaged[place] = rng.integers(0, 256)
            with open(self.path("bad.exr"), "wb") as file:
                file.write(damaged)
            try:
                exr.read(self.path("bad.exr"))
            except exr.NotReadable:
                pass


if __name__ == "__main__":
    scenes.run_tests(sys.modules[__name__])
