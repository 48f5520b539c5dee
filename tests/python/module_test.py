"""The Python package against files, the command line and its own promises."""

import ast
import copy
import inspect
import json
import logging
import multiprocessing
import os
import pathlib
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
import time
import unittest
import urllib.request

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
            ({"exposure": -1}, "exposure -1: expected header, auto or a number above 0"),
            ({"filter": "sbf"}, "."),
        ):
            with self.assertRaisesRegex(brume.InputError, words):
                brume.denoise({"R": frame["R"]} if keywords == {"filter": "sbf"} else frame, **keywords)
        with self.assertRaisesRegex(brume.InputError, "the layers before it have 23 x 37"):
            brume.denoise({"R": frame["R"], "G": np.zeros((2, 2))})
        with self.assertRaisesRegex(brume.InputError, r"layers\['beauty'\]: expected an array of numbers, found str"):
            brume.denoise("a.exr")
        self.assertTrue(issubclass(brume.InputError, ValueError))


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


class Metrics(Folder):
    def test_they_equal_the_command_lines(self):
        a, b = brume.render(CLOUD, spp=2, **TINY), brume.render(CLOUD, spp=4, seed=3, **TINY)
        brume.write(self.folder / "a.exr", a)
        brume.write(self.folder / "b.exr", b)
        told = json.loads(run("compare", self.folder / "a.exr", self.folder / "b.exr", "--json", "-q"))
        self.assertEqual(brume.metrics(a, b), {**told["metrics"], "medium": told["medium"]})

    def test_a_picture_equals_itself(self):
        image = np.random.default_rng(1).random((9, 8, 3), dtype=np.float32)
        errors = brume.metrics(image, image)
        self.assertEqual((errors["lab_rms"], errors["mse"], errors["pixels"]), (0, 0, 72))
        self.assertAlmostEqual(brume.metrics(image + np.float32(0.5), image)["mse"], 0.25, places=6)

    def test_other_sizes_are_refused(self):
        with self.assertRaisesRegex(brume.InputError, "picture is 3 x 2, reference is 2 x 2"):
            brume.metrics(np.zeros((2, 3, 3)), np.zeros((2, 2, 3)))


class Declarations(unittest.TestCase):
    def test_filters_are_those_of_the_command_line(self):
        self.assertEqual(brume.filters(), json.loads(run("filters", "--json"))["filters"])

    def test_help_and_stubs_have_every_filter_and_parameter(self):
        stub = ast.parse((pathlib.Path(brume.__file__).parent / "__init__.pyi").read_text())
        overloads = {}
        for node in stub.body:
            if isinstance(node, ast.FunctionDef) and node.name == "denoise":
                arguments = {a.arg.rstrip("_") for a in node.args.args + node.args.kwonlyargs}
                kind = ast.unparse(next(a for a in node.args.args if a.arg == "filter").annotation)
                overloads[kind] = arguments
        for entry in brume.filters():
            wanted = {p["name"].replace("-", "_") for p in entry["parameters"]}
            self.assertLessEqual(wanted, overloads[f"Literal[{entry['name']!r}]"])
            self.assertIn(entry["name"] + ": " + entry["summary"], brume.denoise.__doc__)
            for parameter in entry["parameters"]:
                self.assertIn(f"    {parameter['name']}: {parameter['help']}", brume.denoise.__doc__)

    def test_stubs_name_what_the_package_has(self):
        stub = ast.parse((pathlib.Path(brume.__file__).parent / "__init__.pyi").read_text())
        named = {node.name for node in stub.body if isinstance(node, (ast.FunctionDef, ast.ClassDef))}
        self.assertEqual(named, set(brume.__all__))
        layers = next(n for n in stub.body if isinstance(n, ast.ClassDef) and n.name == "Layers")
        methods = {n.name for n in layers.body if isinstance(n, ast.FunctionDef)}
        self.assertLessEqual({n for n in vars(brume.Layers) if not n.startswith("_")}, methods)

    def test_everything_public_has_a_signature(self):
        public = [getattr(brume, name) for name in brume.__all__ if name != "InputError"]
        public += [member for name, member in vars(brume.Layers).items() if callable(member) and not name.startswith("_")]
        self.assertGreater(len(public), 12)
        for thing in public:
            parameters = inspect.signature(thing).parameters
            for name in parameters:
                self.assertNotRegex(name, "^arg[0-9]", thing)
        self.assertEqual(
            str(inspect.signature(brume.write)).replace("'", ""), "(path: object, layers: object) -> None"
        )
        self.assertIs(inspect.signature(brume.render).parameters["statistics"].default, True)
        inspect.signature(brume.render).bind("cloud.toml", spp=4, camera__fov=30)
        with self.assertRaises(TypeError):
            inspect.signature(brume.read).bind()
        self.assertEqual(list(inspect.signature(brume.Layers).parameters), ["channels", "header", "like"])
        inspect.signature(brume.InputError)

    def test_a_view_is_served_until_the_end(self):
        address = brume.view(CLOUD, camera__fov=20)
        self.assertRegex(address, r"^http://127\.0\.0\.1:[0-9]+/[0-9a-f]{32}/$")
        with urllib.request.urlopen(address + "scene.toml") as answer:
            self.assertEqual(answer.status, 200)
        with self.assertRaisesRegex(brume.InputError, "no such file"):
            brume.view("missing.toml")

    def test_the_version_is_the_programs(self):
        self.assertEqual(run("--version").split()[1], brume.__version__)


class WhileItWorks(unittest.TestCase):
    def test_progress_rises_to_one_in_the_callers_thread(self):
        told = []
        brume.render(CLOUD, spp=16, **TINY, progress=lambda f: told.append((f, threading.get_ident())))
        self.assertEqual(told[-1][0], 1.0)
        self.assertEqual(sorted(told), told)
        self.assertEqual({thread for _, thread in told}, {threading.get_ident()})

    def test_an_exception_of_the_callback_ends_the_work(self):
        def refuse(fraction):
            raise LookupError("enough")

        with self.assertRaisesRegex(LookupError, "enough"):
            brume.render(CLOUD, spp=1 << 20, progress=refuse)

    def test_keyboard_interrupt_ends_the_work(self):
        # What Ctrl-C sends, once the render is on its way; without an answer to it this would take days.
        timer = threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT))
        timer.start()
        self.addCleanup(timer.cancel)
        with self.assertRaises(KeyboardInterrupt):
            brume.render(CLOUD, spp=1 << 20)

    def test_other_threads_run_meanwhile(self):
        # The render would take days: it ends because the other thread gets on with its counting.
        counted = threading.Event()

        def count():
            for _ in range(100):
                time.sleep(0.001)
            counted.set()

        def stop_when_counted(fraction):
            if counted.is_set():
                raise StopIteration

        counter = threading.Thread(target=count)
        counter.start()
        with self.assertRaises(StopIteration):
            brume.render(CLOUD, spp=1 << 20, progress=stop_when_counted)
        counter.join()

    def test_several_processes_may_clean_at_once(self):
        frames = [random_frame(23, 37), random_frame(11, 7)]
        with multiprocessing.get_context("spawn").Pool(2) as pool:
            for frame, clean in zip(frames, pool.map(brume.denoise, frames)):
                np.testing.assert_array_equal(clean.image(), brume.denoise(frame).image())

    def test_several_threads_may_clean_at_once(self):
        frame, results = random_frame(), []
        expected = brume.denoise(frame, "nl_means").image()
        workers = [threading.Thread(target=lambda: results.append(brume.denoise(frame, "nl_means"))) for _ in range(4)]
        for worker in workers:
            worker.start()
        for worker in workers:
            worker.join()
        self.assertEqual(len(results), 4)
        for result in results:
            np.testing.assert_array_equal(result.image(), expected)


if __name__ == "__main__":
    unittest.main()
