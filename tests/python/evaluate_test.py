"""brume.evaluate: functions of one's own beside brume's filters. And the examples of docs/filters.md."""

import contextlib
import functools
import io
import json
import logging
import os
import pathlib
import re
import signal
import subprocess
import sys
import threading
import time
import unittest

import numpy as np

import brume
from brume._fingerprint import fingerprint
from support import CLOUD, PROGRAM, SOURCE, Folder

# A scene in which something scatters and nothing needs a file.
BOX = """
[camera]
position = [0.0, -4.0, 0.0]
look_at = [0.0, 0.0, 0.0]
up = [0.0, 0.0, 1.0]
fov = 40.0
[film]
width = 12
height = 10
[environment]
radiance = [0.5, 0.75, 1.0]
[[volumes]]
shape = "box"
lo = [-0.8, -0.8, -0.8]
hi = [0.8, 0.8, 0.8]
sigma_t = 2
albedo = 0.9
"""
QUICK = {"spp": 4, "seeds": 2, "reference_spp": 16, "search": False, "component": "all", "threads": 2}


def copy_of(frame):
    return frame.image()


def mean(frame):
    x = frame.image()
    return np.mean([np.roll(x, (dy, dx), (0, 1)) for dy in (-1, 0, 1) for dx in (-1, 0, 1)], axis=0)


class Evaluations(Folder):
    def setUp(self):
        super().setUp()
        self.scene = self.folder / "box.toml"
        self.scene.write_text(BOX)

    def evaluate(self, filters, **more):
        return brume.evaluate(self.scene, filters, **{**QUICK, **more})

    def rows(self, results, region="frame"):
        return {row["method"]: row for row in results["rows"] if row["region"] == region}

    def test_a_function_stands_in_the_table_beside_the_others(self):
        results = self.evaluate({"mine": mean, "narrow": "gaussian:sigma=0.5"}, output=self.folder / "out")
        self.assertEqual(results, json.loads((self.folder / "out/results.json").read_text()))
        rows = self.rows(results)
        self.assertEqual(set(rows), {"noisy", "mine_default", "narrow_default"})
        error = {name: row["metrics"]["lab_rms"]["mean"] for name, row in rows.items()}
        self.assertLess(error["mine_default"], error["noisy"])
        self.assertGreater(rows["mine_default"]["seconds"]["filter"], 0)
        self.assertGreater(rows["mine_default"]["seconds"]["exchange"], 0)
        method = next(m for m in results["methods"] if m["label"] == "mine")
        self.assertEqual((method["filter"], method["command"], method["setting"]), ("function", "mean", "default"))
        for name in ("table.md", "table.csv", "index.html", "box_error_seconds.svg", "box_4spp_mine_default.exr"):
            self.assertTrue((self.folder / "out" / name).exists(), name)
        self.assertIn("| mine |", (self.folder / "out/table.md").read_text())
        clean = brume.read(self.folder / "out/box_4spp_mine_default.exr")
        noisy = brume.read(self.folder / "out/box_4spp_noisy.exr")
        np.testing.assert_allclose(clean.image(), mean(noisy), rtol=1e-6)

    def test_it_gets_the_component_and_what_it_asks_for(self):
        seen = []

        def look(frame):
            seen.append((frame.keys(), threading.get_ident(), frame.header["samplesPerPixel"]))
            return brume.Layers({"beauty": 2 * frame.image()}, like=frame)

        results = self.evaluate({"twice": look}, component="indirect", output=self.folder / "out")
        self.assertEqual(seen[0], (["A", "B", "G", "R", "coverage.A"], threading.get_ident(), 4))
        self.assertNotIn("failed", self.rows(results)["twice_default"])
        twice = brume.read(self.folder / "out/box_4spp_twice_default.exr").image()
        # The direct light is added back as it was.
        noisy = brume.evaluate(self.scene, {"as it is": copy_of}, **{**QUICK, "component": "indirect"}, output=self.folder / "one")
        once = brume.read(self.folder / "one/box_4spp_as_it_is_default.exr").image()
        raw = brume.read(self.folder / "one/box_4spp_noisy.exr").image()
        np.testing.assert_array_equal(once, raw)
        self.assertTrue((twice >= once).all() and (twice > once).any() and (twice < 2 * once).any())

        look.layers, look.statistics = ["albedo", "guides"], True
        del seen[:]
        results = self.evaluate({"twice": look})
        self.assertLessEqual({"albedo.R", "albedo.half_a.G", "mean_variance.B", "half_b.R", "guide.opacity.Y"}, set(seen[0][0]))
        self.assertGreater(self.rows(results)["twice_default"]["seconds"]["guides"], 0)

    def test_lists_replace_and_mappings_add(self):
        experiment = self.folder / "e.toml"
        experiment.write_text(
            'scenes = ["box.toml"]\nspp = [2]\nseeds = 1\nreference_spp = 4\nsearch = false\n'
            'component = "all"\n[[filters]]\nfilter = "gaussian"\n'
        )
        labels = lambda results: {m["label"] for m in results["methods"]} - {"path tracing"}
        self.assertEqual(labels(brume.evaluate(experiment)), {"gaussian"})
        self.assertEqual(labels(brume.evaluate(experiment, {"mine": mean})), {"gaussian", "mine"})
        self.assertEqual(labels(brume.evaluate(experiment, [mean, "bilateral"])), {"mean", "bilateral"})
        self.assertEqual(labels(brume.evaluate(experiment, mean)), {"mean"})
        # Programs and functions in one run.
        text = experiment.read_text()
        experiment.write_text(text + '[[filters]]\ncommand = "cp {color.pfm} {output.pfm}"\nlabel = "copied"\n')
        rows = self.rows(brume.evaluate(experiment, {"copy": copy_of}))
        self.assertEqual(rows["copied_default"]["metrics"], rows["copy_default"]["metrics"])
        self.assertEqual(rows["copied_default"]["metrics"], rows["noisy"]["metrics"])
        results = brume.evaluate([self.scene], "bilateral", **{**QUICK, "spp": (2, 3), "seeds": 1}, film__width=5)
        self.assertEqual((results["spp"], results["scenes"][0]["width"]), ([2, 3], 5))

    def test_an_exception_is_the_filters_failure(self):
        def inner():
            raise ValueError("not today")

        def broken(frame):
            inner()

        def grey(frame):
            return frame["R"]

        def holes(frame):
            x = frame.image()
            x[3, 4, 1] = np.nan
            return x

        filters = {"broken": broken, "grey": grey, "holes": holes, "nothing": lambda frame: None, "small": lambda frame: copy_of(frame)[:5],
                   "complex": lambda frame: 1j * copy_of(frame), "good": copy_of}
        rows = self.rows(self.evaluate(filters))
        failed = {name: row.get("failed", "") for name, row in rows.items()}
        self.assertRegex(failed["broken_default"], r"^seed 1: raised ValueError; its last words: .*evaluate_test.py.*in inner / "
                         r'raise ValueError\("not today"\) / ValueError: not today$')
        self.assertRegex(failed["grey_default"], "its picture has no channels R, G, B|its result is no picture")
        self.assertIn("1 of the 120 pixels of its picture are NaN or infinite, the first in column 4, row 3", failed["holes_default"])
        self.assertIn("its result is no picture: it gave nothing back (None)", failed["nothing_default"])
        self.assertIn("its picture has 12 x 5 pixels, expected 12 x 10", failed["small_default"])
        self.assertIn("expected real numbers, found complex", failed["complex_default"])
        self.assertEqual(failed["good_default"], "")

    def test_too_long_is_a_failure(self):
        def slow(frame):
            time.sleep(0.02)
            return frame

        slow.time_limit = 0.01
        self.assertEqual(self.rows(self.evaluate({"slow": slow}))["slow_default"]["failed"], "seed 1: took longer than 0.01 s")

    def test_keyboard_interrupt_ends_the_run(self):
        called = []

        def interrupted(frame):
            called.append(1)
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(1000)  # the signal ends it

        with self.assertRaises(KeyboardInterrupt):
            self.evaluate({"mine": interrupted}, output=self.folder / "out")
        self.assertEqual(len(called), 1)
        self.assertFalse((self.folder / "out").exists())
        with self.assertRaises(SystemExit):
            self.evaluate({"mine": lambda frame: sys.exit(3)})

    def test_brume_may_be_used_inside(self):
        def cleaned(frame):
            return brume.denoise(frame, "gaussian", average="linear", outliers="keep")

        rows = self.rows(self.evaluate({"mine": cleaned, "keep": "gaussian:average=linear"}))
        self.assertNotIn("failed", rows["mine_default"])
        self.assertAlmostEqual(
            rows["mine_default"]["metrics"]["lab_rms"]["mean"], rows["keep_default"]["metrics"]["lab_rms"]["mean"], 2
        )

    def test_results_are_kept_under_the_functions_code(self):
        calls = []
        strength = 0.5

        def count():
            calls.append(1)

        count.cache_key = "counts"  # a list that grows is no part of it

        def mine(frame):
            count()
            return strength * frame.image()

        def run():
            del calls[:]
            self.evaluate({"mine": mine}, cache=self.folder / "cache")
            return len(calls)

        self.assertEqual(run(), 4)  # two seeds, each twice as it takes less than a second
        self.assertEqual(run(), 0)
        strength = 0.25
        self.assertEqual(run(), 4)
        strength = 0.5
        self.assertEqual(run(), 0)
        mine.statistics = True
        self.assertEqual(run(), 4)
        mine.cache_key = "version 1"
        self.assertEqual(run(), 4)
        strength = 0.25
        self.assertEqual(run(), 0)

    def test_what_cannot_be_pickled_is_refused_with_a_cache_only(self):
        lock = threading.Lock()

        def mine(frame):
            with lock:
                return frame.image()

        with self.assertRaisesRegex(brume.InputError, r"filters\['mine'\]: 'lock', which it closes over, is a lock, which cannot be "
                                    r"pickled .*set its attribute cache_key"):
            self.evaluate({"mine": mine}, cache=self.folder / "cache")
        self.assertNotIn("failed", self.rows(self.evaluate({"mine": mine}))["mine_default"])
        mine.cache_key = 3
        self.assertNotIn("failed", self.rows(self.evaluate({"mine": mine}, cache=self.folder / "cache"))["mine_default"])

    def test_wrong_arguments_are_named(self):
        def layered(frame):
            return frame

        layered.layers = ["albdo"]
        for arguments, words in (
            ({"filters": {"bilateral": mean}}, r"a filter of yours \(`mean`\) is called 'bilateral', as one of brume's"),
            ({"filters": {"mine": 3}}, r"filters\['mine'\]: expected a function or a filter's name, found 3"),
            ({"filters": {"mine": layered}}, r"no layer 'albdo' for filters\['mine'\].layers; did you mean 'albedo'"),
            ({"filters": [mean, mean]}, "two filters are called 'mean'"),
            ({"filters": "bilat"}, "no filter 'bilat'"),
            ({"filters": functools.partial(mean)}, "filters: one has no name"),
            ({"filters": mean, "spp": 0}, "spp: expected 1 .. 1048576, found 0"),
            ({"filters": mean, "seeds": 0}, "seeds: expected 1 .. 1000, found 0"),
            ({"filters": mean, "component": "some"}, "some"),
            ({"filters": mean, "camera__fof": 3}, "camera.fof|'fof'"),
        ):
            with self.assertRaisesRegex(brume.InputError, words):
                self.evaluate(**arguments)
        with self.assertRaisesRegex(brume.InputError, "missing.toml"):
            brume.evaluate("missing.toml", mean)

    def test_attributes_of_a_function_are_named(self):
        for attribute, value, words in (
            ("time_limit", "3", "expected a number of 0 or more, found '3'"),
            ("time_limit", -1, "expected a number of 0 or more, found -1"),
            ("time_limit", float("nan"), "expected a number of 0 or more, found nan"),
            ("statistics", "yes", "expected True or False, found 'yes'"),
        ):
            f = lambda frame: frame.image()
            setattr(f, attribute, value)
            with self.assertRaisesRegex(brume.InputError, rf"filters\['mine'\].{attribute}: {words}"):
                self.evaluate({"mine": f})
        for keywords, words in (
            ({"search": "yes"}, "search: expected True or False, found 'yes'"),
            ({"spp": "4"}, "spp: expected a whole number, 1 .. 1048576, found '4'"),
            ({"spp": [4, 2.5]}, "spp: expected a whole number, 1 .. 1048576, found 2.5"),
            ({"size": 2.5}, "size: expected a whole number, 1 .. 65536, found 2.5"),
        ):
            with self.assertRaisesRegex(brume.InputError, words):
                self.evaluate({"mine": mean}, **keywords)
        self.evaluate({"mine": mean}, spp=np.array([2, 4]))

    def test_a_call_with_the_wrong_arguments_is_the_filters_failure(self):
        rows = self.rows(self.evaluate({"none": lambda: None, "mean": mean}))
        self.assertIn("raised TypeError; its last words: TypeError: ", rows["none_default"]["failed"])
        self.assertNotIn("failed", rows["mean_default"])

    def test_labels_are_names_that_tables_can_hold(self):
        with self.assertRaisesRegex(brume.InputError, r'a filter is called "a\\nb"; expected a label without line breaks'):
            self.evaluate({"a\nb": mean})
        # One that follows from the script's name too.
        experiment = self.folder / "e.toml"
        (self.folder / "bilateral.py").write_text("")
        experiment.write_text('scenes = ["box.toml"]\n[[filters]]\ncommand = "python3 bilateral.py {frame} {output}"\n')
        with self.assertRaisesRegex(brume.InputError, r"`python3 bilateral.py .*is called 'bilateral', as one of brume's"):
            brume.evaluate(experiment)

    def test_progress_rises_to_one_and_notes_are_logged(self):
        told = []
        with self.assertLogs("brume", logging.WARNING) as log:
            self.evaluate({"mine": mean}, progress=told.append, search=True)
        self.assertEqual(sorted(told), told)
        self.assertEqual(told[-1], 1.0)
        self.assertIn("mine is `mean`: no parameters of it are known", "\n".join(log.output))


SCALE = 2


def helper(x):
    return SCALE * x


def calls_helper(frame):
    return helper(frame.image())


class Scaled:
    def __init__(self, factor):
        self.factor = factor

    def __call__(self, frame):
        return self.factor * frame.image()

    def method(self, frame):
        return self.factor * frame.image()


class Fingerprints(Folder):
    def test_the_same_code_has_the_same_wherever_it_stands(self):
        source = "def f(frame, k=1):\n    return k * frame.image()\n"
        prints = set()
        for text in (source, "\n\n# moved\n" + source):
            scope = {}
            exec(text, scope)
            prints.add(fingerprint(scope["f"]))
        self.assertEqual(len(prints), 1)
        # Another process comes to the same.
        script = "import brume._fingerprint as f, evaluate_test as t; print(f.fingerprint(t.calls_helper), f.fingerprint(t.Scaled(2)))"
        said = {
            subprocess.run([sys.executable, "-c", script], cwd=pathlib.Path(__file__).parent, capture_output=True, text=True,
                           check=True, env={**os.environ, "PYTHONHASHSEED": str(seed)}).stdout
            for seed in (1, 2)
        }
        self.assertEqual(len(said), 1)

    def test_everything_that_decides_changes_it(self):
        global SCALE

        def closing(value):
            return lambda frame: frame.image() * value

        found = []

        def is_new(function):
            found.append(fingerprint(function))
            self.assertEqual(found[-1], fingerprint(function))
            self.assertEqual(len(set(found)), len(found), function)

        is_new(lambda frame: frame.image() * 2)
        is_new(lambda frame: frame.image() * 3)
        is_new(lambda frame: frame.image() + 2)
        is_new(lambda frame, k=2: frame.image() * k)
        is_new(lambda frame, k=3: frame.image() * k)
        is_new(lambda frame, *, k=3: frame.image() * k)
        is_new(closing(2))
        is_new(closing(2.5))
        is_new(closing(np.arange(3.0)))
        is_new(closing(np.arange(1, 4.0)))
        is_new(closing({"a", "b"}))
        is_new(closing(helper))
        is_new(closing(calls_helper))
        is_new(functools.partial(mean))
        is_new(functools.partial(mean, k=3))
        is_new(Scaled(2))
        is_new(Scaled(3))
        is_new(Scaled(2).method)
        is_new(np.square)
        # Functions inside of values, whose pickle has their names alone.
        is_new(closing([helper]))
        is_new(closing({"first": calls_helper}))
        is_new(closing(np.vectorize(lambda x: x + 1)))
        is_new(closing(np.vectorize(lambda x: x + 2)))
        is_new(closing(functools.lru_cache(lambda x: x + 1)))
        is_new(closing(functools.lru_cache(lambda x: x + 2)))
        is_new(closing([Scaled(2).method]))
        is_new(calls_helper)
        SCALE = 3  # what a helper names of its module
        is_new(calls_helper)
        SCALE = 2

    def test_modules_that_are_not_installed_count_by_their_files(self):
        # stages.py calls what tools/ has; f names stages, or a function of it.
        def prints(ends):
            script = f"import brume._fingerprint as p, stages\nfrom stages import twice\nFUNCTION = [twice]\n" + "".join(
                f"print(p.fingerprint(lambda frame: {end}))\n" for end in ends)
            (self.folder / "main.py").write_text(script)
            return subprocess.run([sys.executable, self.folder / "main.py"], capture_output=True, text=True, check=True,
                                  env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}).stdout.splitlines()

        (self.folder / "tools").mkdir()
        tools = self.folder / "tools/inner.py"
        tools.write_text("FACTOR = 2\n")
        stages = self.folder / "stages.py"
        stages.write_text("from tools import inner\ndef twice(x):\n    return inner.FACTOR * x\n")
        ends = ("stages.twice(frame)", "twice(frame)", "FUNCTION[0](frame)")
        first = prints(ends)
        self.assertEqual(prints(ends), first)
        self.assertEqual(len(set(first)), 3)
        for file, text in ((tools, "FACTOR = 3\n"), (stages, stages.read_text().replace("*", "+"))):
            file.write_text(text)
            later = prints(ends)
            for before, after in zip(first, later):
                self.assertNotEqual(before, after, file)
            first = later

    def test_attributes_are_no_values_of_the_module(self):
        scope = {"image": threading.Lock()}
        exec("def f(frame):\n    return frame.image()\n", scope)
        fingerprint(scope["f"])
        exec("def g(frame):\n    return image\n", scope)
        with self.assertRaisesRegex(ValueError, "'image', which it names, is a lock"):
            fingerprint(scope["g"])

    def test_functions_may_call_themselves_and_one_another(self):
        def even(n):
            return n == 0 or odd(n - 1)

        def odd(n):
            return n != 0 and even(n - 1)

        self.assertNotEqual(fingerprint(even), fingerprint(odd))


class Examples(Folder):
    """What docs/filters.md shows, as it stands there."""

    def setUp(self):
        super().setUp()
        page = (SOURCE / "docs/filters.md").read_text()
        self.script, self.function = re.findall(r"```python\n(.*?)```", page, re.S)
        self.experiment = re.search(r"```toml\n(scenes.*?)```", page, re.S)[1]
        (self.folder / "data").symlink_to(SOURCE / "data")

    def run_program(self, *arguments):
        """With the interpreter of this test as python3."""
        (self.folder / "bin").mkdir(exist_ok=True)
        python = self.folder / "bin/python3"
        if not python.exists():
            python.symlink_to(sys.executable)
        path = f"{self.folder / 'bin'}:{os.environ['PATH']}"
        return subprocess.run([PROGRAM, *map(str, arguments), "-o", "results", "--threads", "2"], cwd=self.folder,
                              env={**os.environ, "PATH": path}, capture_output=True, text=True)

    def rows(self):
        return json.loads((self.folder / "results/results.json").read_text())["rows"]

    def test_ten_lines_of_python_are_a_row_in_the_table(self):
        self.assertLessEqual(len(self.script.splitlines()) + len(self.experiment.splitlines()), 10)
        (self.folder / "mine.py").write_text(self.script)
        (self.folder / "mine.toml").write_text(self.experiment)
        small = ("--size", 24, "--spp", 4, "--seeds", 2, "--reference-spp", 16, "--no-tuning")
        ran = self.run_program("evaluate", "mine.toml", *small)
        self.assertEqual(ran.returncode, 0, ran.stderr)
        self.assertEqual({r["method"] for r in self.rows() if "failed" not in r}, {"noisy", "bilateral_default", "bilateral_paper", "mine_default"})
        self.assertRegex(ran.stdout, r"\nmine +[0-9.]+ ±")

    def test_ten_lines_with_a_function_are_a_row_in_the_table(self):
        self.assertLessEqual(len([line for line in self.function.splitlines() if line]), 10)
        small = {"size": 20, "spp": (2, 16), "seeds": 1, "reference_spp": 4}
        evaluate = brume.evaluate
        self.addCleanup(setattr, brume, "evaluate", evaluate)
        brume.evaluate = functools.partial(evaluate, **small)
        with contextlib.chdir(self.folder) if hasattr(contextlib, "chdir") else _in_folder(self.folder):
            exec(self.function, {"__name__": "example"})
        self.assertEqual(len([r for r in self.rows() if r["method"] == "mine_default" and "failed" not in r]), 2 * 2 * 2)
        self.assertTrue((self.folder / "results/index.html").exists())

    def test_the_experiment_with_two_scripts_runs(self):
        small = ("--size", 24, "--spp", 4, "--seeds", 2, "--reference-spp", 64)
        ran = self.run_program("evaluate", "data/experiments/of_others.toml", *small)
        self.assertEqual(ran.returncode, 0, ran.stderr)
        errors = {}
        for row in self.rows():
            self.assertNotIn("failed", row)
            if row["scene"] == "cloud" and row["region"] == "frame":
                errors[row["method"]] = row["metrics"]["lab_rms"]["mean"]
        for mine in ("joint_bilateral_default", "mean_of_3_x_3_default"):
            self.assertLess(errors[mine], 0.8 * errors["noisy"])


@contextlib.contextmanager
def _in_folder(folder):
    before = os.getcwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


if __name__ == "__main__":
    unittest.main()
