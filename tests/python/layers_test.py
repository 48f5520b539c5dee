"""Layers in memory and in files."""

import copy
import pickle
import subprocess
import sys
import unittest

import numpy as np

import brume
from support import TEXT, Folder, random_frame, run


class Files(Folder):
    def test_what_is_written_is_read_again_to_the_bit(self):
        values = np.random.default_rng(1).integers(0, 2**32, (21, 33), dtype=np.uint32).view(np.float32)
        values[0, :4] = [np.nan, np.inf, -np.inf, -0.0]
        frame = brume.Layers({"R": values, "G": -values, "B": values, "any.name.Q": values},
                             header={"owner": "grüß", "n": 3, "f": 0.5, "worldToNDC": np.eye(4)})
        path = self.folder / "bits.exr"
        brume.write(path, frame)
        again = brume.read(path)
        self.assertEqual(again.keys(), frame.keys())
        for name in frame:
            bits = np.ascontiguousarray(again[name]).view(np.uint32)
            np.testing.assert_array_equal(bits, np.ascontiguousarray(frame[name]).view(np.uint32))
        self.assertEqual((again.header["owner"], again.header["n"], again.header["f"]), ("grüß", 3, 0.5))
        np.testing.assert_array_equal(again.header["worldToNDC"], np.eye(4))

    def test_a_mapping_is_written_as_layers_are(self):
        image = np.random.default_rng(1).random((5, 7, 3), dtype=np.float32)
        brume.write(self.folder / "a.exr", {"beauty": image, "direct": image, "depth.Z": image[:, :, 0]})
        again = brume.read(self.folder / "a.exr")
        self.assertEqual(again.keys(), ["B", "G", "R", "depth.Z", "direct.B", "direct.G", "direct.R"])
        np.testing.assert_array_equal(again.image(), image)
        np.testing.assert_array_equal(again.image("direct"), image)
        np.testing.assert_array_equal(again["depth.Z"], image[:, :, 0])

    def test_channels_are_chosen_by_layer_or_name(self):
        brume.write(self.folder / "a.exr", random_frame())
        self.assertEqual(brume.read(self.folder / "a.exr", "R").keys(), ["R"])
        self.assertIn("direct.half_a.G", brume.read(self.folder / "a.exr", ["direct"]))
        with self.assertRaisesRegex(brume.InputError, "no channel speed; it has: .*indirect"):
            brume.read(self.folder / "a.exr", "speed")

    def test_too_little_memory_is_a_memory_error(self):
        brume.write(self.folder / "large.exr", {name: np.zeros((1024, 2048), np.float32) for name in "RGBA"})
        # Room for a thread's stack, not for 32 MB of pixels.
        script = """if True:
            import resource, sys, brume
            pages = int(open("/proc/self/statm").read().split()[0])
            limit = pages * resource.getpagesize() + (24 << 20)
            resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
            try:
                brume.read(sys.argv[1])
            except MemoryError as error:
                print(error)"""
        said = subprocess.run([sys.executable, "-c", script, self.folder / "large.exr"], stdout=subprocess.PIPE, text=True).stdout
        self.assertRegex(said, "large.exr: not enough memory to hold its pixels, which takes at least .* MB")

    def test_windows_of_a_crop_are_kept(self):
        whole = brume.render(TEXT, spp=1)
        crop = brume.render(TEXT, spp=1, crop=(3, 2, 11, 9))
        self.assertEqual(crop.data_window, (3, 2, 11, 9))
        self.assertEqual(crop.display_window, whole.display_window)
        brume.write(self.folder / "crop.exr", brume.Layers(dict(crop.items()), like=crop))
        self.assertEqual(brume.read(self.folder / "crop.exr").data_window, (3, 2, 11, 9))
        np.testing.assert_array_equal(crop["B"], whole["B"][2:9, 3:11])

    def test_lights_of_other_renderers_are_mixed(self):
        rng = np.random.default_rng(1)
        parts = {name: rng.random((5, 7, 3)).astype(np.float32) for name in ("key", "rim", "rest")}
        frame = brume.Layers({"V.Combined": sum(parts.values()), "V.Combined_key": parts["key"],
                              "V.Combined_rim": parts["rim"], "V.Depth": np.ones((5, 7), np.float32)})
        expected = parts["rest"] + 2 * parts["key"]
        path = self.folder / "cycles.exr"
        brume.write(path, frame)
        for given in (frame, path, brume.read(path)):
            mixed = brume.mix(given, gain={"key": 2, "rim": 0})
            np.testing.assert_allclose(mixed.image(), expected, atol=1e-6)
            np.testing.assert_allclose(mixed.image("V.Combined"), expected, atol=1e-6)
        with self.assertRaisesRegex(brume.InputError, "fill"):
            brume.mix(frame, gain={"fill": 2})
        (self.folder / "map.toml").write_text('color = "V.Combined"\nlights = ["V.Combined_rim"]\n')
        mixed = brume.mix(path, map=self.folder / "map.toml", gain={"V.Combined_rim": 0})
        np.testing.assert_allclose(mixed.image(), parts["rest"] + parts["key"], atol=1e-6)
        with self.assertRaisesRegex(brume.InputError, "map"):
            brume.mix(frame, map="map.toml")
        with self.assertRaisesRegex(brume.InputError, "light"):
            brume.mix({"R": np.zeros((2, 2), np.float32)})


class Views(unittest.TestCase):
    def test_channels_look_into_the_memory_of_the_frame(self):
        frame = random_frame()
        first, second = frame["R"], frame["R"]
        self.assertTrue(np.shares_memory(first, second))
        self.assertEqual(first.__array_interface__["data"], second.__array_interface__["data"])
        self.assertEqual((first.dtype, first.shape), (np.float32, (23, 37)))
        self.assertEqual(first.strides, (64 * 3, 4))  # an odd number of cache lines
        first[4, 5] = 42
        self.assertEqual(second[4, 5], 42)
        self.assertEqual(frame.image()[4, 5, 0], 42)

    def test_results_are_views_and_live_longer_than_their_frame(self):
        clean = brume.denoise(random_frame(), "gaussian")
        expected = clean.image()
        red = clean["R"]
        self.assertTrue(np.shares_memory(red, clean["R"]))
        del clean
        np.testing.assert_array_equal(red, expected[:, :, 0])

    def test_assignment_fills_the_memory_that_views_show(self):
        frame = random_frame()
        view = frame["G"]
        frame["G"] = np.full((23, 37), 0.25)
        self.assertEqual(view.min(), 0.25)
        frame["new.Y"] = 2
        self.assertEqual(frame["new.Y"].max(), 2)
        with self.assertRaisesRegex(brume.InputError, r"layers\['G'\]: expected 23 x 37 .*found 37 x 23"):
            frame["G"] = np.zeros((37, 23))

    def test_a_frame_is_a_mapping(self):
        frame = random_frame()
        self.assertEqual(set(frame), set(frame.keys()))
        self.assertEqual(len(frame), len(frame.keys()))
        self.assertIn("R", frame)
        self.assertNotIn(3, frame)
        self.assertIsNone(frame.get("none"))
        with self.assertRaisesRegex(KeyError, "no channel 'indirekt.R'; did you mean 'indirect.R'"):
            frame["indirekt.R"]

    def test_a_copy_has_memory_of_its_own(self):
        frame = random_frame()
        self.assertFalse(np.shares_memory(frame["R"], frame.copy()["R"]))


    def test_a_frame_can_be_pickled_and_copied(self):
        frame = brume.render(TEXT, spp=1, crop=(3, 2, 11, 9))
        frame.header = {**frame.header, "odd": "gr\udcfc\u00df", "third": 1 / 3, "m": np.arange(16.0).reshape(4, 4)}
        copies = [pickle.loads(pickle.dumps(frame, protocol)) for protocol in range(2, pickle.HIGHEST_PROTOCOL + 1)]
        for again in copies + [copy.copy(frame), copy.deepcopy(frame), copy.deepcopy([frame, frame])[1]]:
            self.assertEqual(again.keys(), frame.keys())
            for name in frame:
                np.testing.assert_array_equal(again[name], frame[name])
                self.assertFalse(np.shares_memory(again[name], frame[name]))
            self.assertEqual((again.data_window, again.display_window), (frame.data_window, frame.display_window))
            self.assertEqual({k: str(v) for k, v in again.header.items()}, {k: str(v) for k, v in frame.header.items()})

    def test_only_arrays_of_real_numbers_are_taken(self):
        frame = random_frame()
        for array, kind in (
            (np.zeros((23, 37), complex), "complex128"),
            (np.zeros((23, 37), object), "object"),
            (np.full((23, 37), "1.5"), "str"),
            (np.zeros((23, 37), "datetime64[s]"), "datetime64"),
            (1j, "complex128"),
        ):
            words = f"expected real numbers, found {kind}"
            with self.assertRaisesRegex(TypeError, r"layers\['G'\]: " + words):
                frame["G"] = array
            with self.assertRaisesRegex(TypeError, words):
                brume.denoise({"R": array}, "gaussian")
        for kind in (bool, np.int8, np.uint64, np.float16, np.longdouble):
            frame["G"] = np.ones((23, 37), kind)
            self.assertEqual(frame["G"].min(), 1)
        with self.assertRaisesRegex(TypeError, r"header\['m'\]: expected real numbers, found complex128"):
            frame.header = {"m": np.eye(4, dtype=complex)}


if __name__ == "__main__":
    unittest.main()
