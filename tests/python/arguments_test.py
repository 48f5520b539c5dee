"""Arguments that are wrong: each is refused by its name before any work begins, and none ends the interpreter."""

import concurrent.futures
import shutil
import subprocess
import sys
import unittest

import numpy as np

import brume
from support import CLOUD, SOURCE, TEXT, Folder, random_frame

# Python code that fails where memory is short, as an exception.
SHORT_OF_MEMORY = """
import resource
import numpy as np
import brume
resource.setrlimit(resource.RLIMIT_AS, (6 << 30, 6 << 30))
one = np.broadcast_to(np.float32(1), (100000, 100000))
frame = brume.Layers({"R": np.ones((2, 2), np.float32)})
vertices = np.broadcast_to(np.float32(1), (1 << 30, 3))
faces = np.broadcast_to(np.int32(1), (1 << 30, 3))
for attempt in (lambda: brume.Layers({"R": one}),
                lambda: brume.Scene({"surfaces": [{"vertices": vertices}]}),
                lambda: brume.Scene({"surfaces": [{"faces": faces}]}),
                lambda: brume.Scene({"volumes": [{"density": np.broadcast_to(np.int8(1), (2048, 2048, 2048))}]})):
    try:
        attempt()
        print("nothing")
    except MemoryError:
        print("MemoryError")
"""


class Interrupting:
    def __array__(self, *more, **others):
        raise KeyboardInterrupt


class Failing:
    def __array__(self, *more, **others):
        raise LookupError


class Arguments(Folder):
    def refused(self, words, call, *arguments, **keywords):
        with self.subTest(words):
            with self.assertRaises(brume.InputError) as caught:
                call(*arguments, **keywords)
            self.assertIn(words, str(caught.exception))

    def test_too_little_memory_is_a_memory_error(self):
        run = subprocess.run([sys.executable, "-c", SHORT_OF_MEMORY], capture_output=True, text=True, check=False)
        self.assertEqual(run.stdout.split(), 4 * ["MemoryError"], run.stderr)

    def test_what_is_no_error_of_the_input_passes_through(self):
        with self.assertRaises(KeyboardInterrupt):
            brume.Layers({"R": Interrupting()})
        self.refused("layers['R']: expected an array of numbers, found Failing", brume.Layers, {"R": Failing()})

    def test_sizes_beyond_an_int_are_refused(self):
        long = np.broadcast_to(np.float32(1), (2**32 + 3, 1))
        self.refused("layers['R']: expected at most 2147483647 rows along an axis, found 4294967299 x 1",
                     brume.Layers, {"R": long})
        self.refused("volumes.0.density: expected at most", brume.Scene, {"volumes": [{"density": long[..., None]}]})

    def test_numbers_are_named(self):
        for words, keywords in (
            ("spp: expected a whole number, 1 .. 16777216, found 1.5", {"spp": 1.5}),
            ("spp: expected a whole number, 1 .. 16777216, found '4'", {"spp": "4"}),
            ("spp: expected 1 .. 16777216, found 0", {"spp": 0}),
            ("spp: expected a whole number, 1 .. 16777216, found array(1.5)", {"spp": np.array(1.5)}),
            (f"seed: expected 0 or more, found {2**70}", {"seed": 2**70}),
            ("seed: expected 0 or more, found -1", {"seed": -1}),
            ("crop: expected (x0, y0, x1, y1), found (1, 2)", {"crop": (1, 2)}),
            ("crop: expected (x0, y0, x1, y1), found 3", {"crop": 3}),
            ("crop: expected (x0, y0, x1, y1), found b'0022'", {"crop": b"0022"}),
            ("crop: expected a whole number", {"crop": (0, 0, 1.5, 2)}),
            ("time: expected a number above 0, found '20s'", {"time": "20s"}),
            ("time: expected a number above 0, found nan", {"time": float("nan")}),
            ("target_error: expected a number above 0, found 0", {"target_error": 0}),
            ("part: expected (i, n), found 3", {"part": 3}),
            ("part (3, 2): expected (i, n) with i from 1 to n", {"part": (3, 2)}),
            ("clean: expected True, False or a filter's name, found 3.5", {"clean": 3.5}),
        ):
            self.refused(words, brume.render, TEXT, **keywords)
        self.refused("samples: expected a whole number, 1 .. 16777216, found 'x'", brume.guides, random_frame(), TEXT, samples="x")
        frame = random_frame(4, 4)
        for words, keywords in (
            ("exposure: expected header, auto or a number above 0, found None", {"exposure": None}),
            ("exposure: expected header, auto or a number above 0, found 'bright'", {"exposure": "bright"}),
            ("exposure: expected header, auto or a number above 0, found -1", {"exposure": -1}),
            ("extra_frames: expected 0 .. 100, found 101", {"extra_frames": 101}),
            ("samples: expected a whole number", {"samples": 1.5}),
        ):
            self.refused(words, brume.denoise, frame, "gaussian", **keywords)
        self.refused("like: expected brume.Layers, found ndarray", brume.Layers, {"R": np.ones((2, 2))}, like=np.ones((2, 2)))
        self.refused("header['n']: expected -2147483648 .. 2147483647, found 1099511627776",
                     brume.Layers, {"R": np.ones((2, 2))}, header={"n": 2**40})

    def test_numbers_of_numpy_are_taken(self):
        frame = brume.render(TEXT, spp=np.uint8(1), seed=np.int64(3), crop=np.array([0, 0, 4, 3]), time=np.float32(100),
                             clean=np.bool_(False), statistics=False)
        self.assertEqual(frame.shape, (3, 4))

    def test_tables_of_a_scene_are_named(self):
        self.refused("volumes: expected a list of dicts, found a dict", brume.Scene, {"volumes": {"density": np.ones((2, 2, 2))}})
        self.refused("volums: no list of dicts; did you mean 'volumes'?", brume.Scene, {"volums": [{}]})
        vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
        self.refused("surfaces.0: has no faces", brume.Scene, {"surfaces": [{"vertices": vertices, "faces": []}]})

    def test_a_table_in_a_table_is_a_dict(self):
        for frame in (1, 2):
            shutil.copy(SOURCE / "data/volumes/fire.vdb", self.folder / f"fire.{frame}.vdb")
        shots = [
            {
                "camera": {"position": [0, -5, 1], "look_at": [0, 0, 1]},
                "film": {"width": 8, "height": 6},
                "render": {"frame": 2, "spp": 1},
                "volumes": [{"file": self.folder / "fire.#.vdb", "time": time}],
            }
            for time in ({"frame": np.array([[1, 1], [5, 2]]), "between": "blend"}, {"beyond": "loop", "offset": None}, {"speed": 2})
        ]
        self.assertEqual(brume.render(shots[0]).shape, (6, 8))
        self.assertEqual(brume.render(shots[1], volumes__0__time__offset=0.5).shape, (6, 8))
        self.refused("unknown key 'speed' in 'time' of [[volumes]]", brume.Scene, shots[2])

    def test_a_view_of_a_wrong_scene_is_refused_at_once(self):
        self.refused("camera.fovv", brume.view, CLOUD, camera__fovv=3)
        self.refused("nowhere.toml: no such file", brume.view, self.folder / "nowhere.toml")
        self.refused("threads: expected 0", brume.view, CLOUD, threads=-1)
        with concurrent.futures.ThreadPoolExecutor(4) as pool:
            addresses = list(pool.map(lambda _: brume.view(CLOUD), range(4)))
        self.assertEqual(len(set(addresses)), 4)

    def test_several_frames_do_not_go_into_one_file(self):
        pattern = self.folder / "o.####.exr"
        for name, file in (("output", "o.exr"), ("png", "o.png"), ("records", "o.records"), ("checkpoint", "c.exr"), ("resume", "c.exr")):
            self.refused(f"{name} {self.folder / file}: all 2 frames would go into one file; expected a name such as shot.####.exr",
                         brume.render, TEXT, frames="1-2", **{"output": pattern, name: self.folder / file})
        self.assertEqual(list(self.folder.iterdir()), [])


if __name__ == "__main__":
    unittest.main()
