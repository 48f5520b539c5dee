"""Sequences, and files that are cleaned where they stand."""

import json
import logging
import shutil
import unittest

import numpy as np

import brume
from support import SOURCE, Folder, assert_same_pixels, run

SMOKE = SOURCE / "data/scenes/smoke.toml"
SIZE = {"film__width": 40, "film__height": 30}
LAYERS = "direct,indirect,guides"


def frames(numbers=range(1, 5), **more):
    return [brume.render(SMOKE, spp=4, layers=LAYERS, render__frame=n, camera__position=[0.05 * n, -5.0, 1.0],
                         **SIZE, **more) for n in numbers]


class InMemory(Folder):
    @classmethod
    def setUpClass(cls):
        cls.shot = frames()

    def test_a_list_is_cleaned_as_the_command_line_cleans_its_files(self):
        for i, frame in enumerate(self.shot, start=1):
            brume.write(self.folder / f"shot.{i:04}.exr", frame)
        for words, keywords in (
            ([], {}),
            (["-f", "transport_regression", "--extra-frames", "1"], {"filter": "transport_regression", "extra_frames": 1}),
            (["-f", "nfor", "--extra-frames", "2"], {"filter": "nfor", "extra_frames": 2}),
            (["-f", "gaussian"], {"filter": "gaussian"}),
        ):
            run("denoise", self.folder / "shot.####.exr", "--frames", "1-4", "-o", self.folder / "clean.####.exr", "-q", *words)
            paths = [self.folder / f"shot.{i:04}.exr" for i in range(1, 5)]
            for given in (self.shot, paths, (self.shot[0], paths[1], dict(self.shot[2].items()), paths[3])):
                # A mapping has no header, which the exposure and the guides' check come from; here both are plain.
                clean = brume.denoise(given, **keywords)
                self.assertEqual(len(clean), 4)
                for i in (0, 1, 3) if isinstance(given, tuple) else range(4):
                    expected = brume.read(self.folder / f"clean.{i + 1:04}.exr")
                    assert_same_pixels(self, clean[i], expected, f"{words} {i}")

    def test_frames_beside_are_looked_into(self):
        alone = [brume.denoise(frame, "transport_regression") for frame in self.shot]
        together = brume.denoise(self.shot, "transport_regression")
        self.assertFalse(np.array_equal(alone[1].image(), together[1].image()))
        for a, b in zip(alone, brume.denoise(self.shot, "transport_regression", extra_frames=0)):
            assert_same_pixels(self, b, a)

    def test_guides_are_given_as_a_list(self):
        plain = [brume.Layers({n: v for n, v in frame.items() if not n.startswith("guide.")}, like=frame)
                 for frame in self.shot]
        guides = [brume.Layers({n: v for n, v in frame.items() if n.startswith("guide.")}, like=frame)
                  for frame in self.shot]
        for i, clean in enumerate(brume.denoise(plain, "transport_regression", guides=guides)):
            np.testing.assert_array_equal(clean.image(), brume.denoise(self.shot, "transport_regression")[i].image())
        with self.assertRaisesRegex(brume.InputError, "guides: expected a list of 4, one for each frame"):
            brume.denoise(plain, guides=guides[:2])
        with self.assertRaisesRegex(brume.InputError, "guides: expected a list of 4"):
            brume.denoise(plain, guides=guides[0])

    def test_other_sizes_and_misplaced_options_are_told(self):
        small = brume.render(SMOKE, spp=4, layers=LAYERS, film__width=20, film__height=10)
        with self.assertLogs("brume", logging.WARNING) as told:
            clean = brume.denoise([self.shot[0], small], "transport_regression")
        self.assertIn("left out beside frame 0: frame 1 has the pixels 0,0,20,10", "\n".join(told.output))
        self.assertEqual(clean[1].shape, (10, 20))
        for keywords, words in (({"suffix": "_clean"}, "are for files; expected output too"),
                                ({"frame_numbers": "1-2"}, "are for files; expected output too"),
                                ({"extra_frames": 101}, "extra_frames: expected 0 .. 100")):
            with self.assertRaisesRegex(brume.InputError, words):
                brume.denoise(self.shot, **keywords)
        with self.assertRaisesRegex(brume.InputError, "extra_frames: are those of a sequence"):
            brume.denoise(self.shot[0], extra_frames=1)

    def test_progress_of_a_sequence_rises_to_one(self):
        told = []
        brume.denoise(self.shot, "gaussian", progress=told.append)
        self.assertEqual((sorted(told), told[-1]), (told, 1.0))


class ToFiles(Folder):
    def test_frames_of_a_scene_are_rendered_into_files(self):
        pattern = self.folder / "shot.####.exr"
        keys = {"camera__position": [0.0, -5.0, 1.0], **SIZE}
        end = brume.render(SMOKE, frames="1-3", spp=2, output=pattern, **keys)
        self.assertEqual(end, {"done": [1, 2, 3], "missed": [], "skipped": [], "failed": []})
        for n in (1, 2, 3):
            expected = brume.render(SMOKE, spp=2, render__frame=n, **keys)
            assert_same_pixels(self, brume.read(self.folder / f"shot.{n:04}.exr"), expected)
        (self.folder / "shot.0002.exr").unlink()
        scene = brume.Scene(SMOKE, **keys)
        end = scene.render(frames="1-3", spp=2, output=pattern, resume=True)
        self.assertEqual((end["done"], end["skipped"]), ([2], [1, 3]))
        self.assertEqual(scene.counts["scenes_prepared"], 1)
        with self.assertRaisesRegex(brume.InputError, "frames: a sequence goes to files"):
            brume.render(SMOKE, frames="1-3")

    def test_volumes_without_frames_are_rendered_all_and_scenes_are_asked_for_them(self):
        for n in (3, 8):
            shutil.copy(SOURCE / "data/volumes/smoke.vdb", self.folder / f"smoke.{n:04}.vdb")
        end = brume.render(self.folder / "smoke.####.vdb", spp=1, output=self.folder / "bare.####.exr", **SIZE)
        self.assertEqual(end["done"], [3, 8])
        self.assertTrue((self.folder / "bare.0008.exr").exists())
        with self.assertRaisesRegex(brume.InputError, "output .*a name for a sequence, of one frame; expected frames, as 1-240"):
            brume.render(SMOKE, spp=1, output=self.folder / "scene.####.exr", **SIZE)

    def test_a_frame_that_fails_is_named_and_the_others_go_on(self):
        with self.assertLogs("brume", logging.WARNING) as told:
            end = brume.render(self.folder / "scene.####.toml", frames="1-2", output=self.folder / "a.####.exr")
        self.assertEqual(end["failed"], [1, 2])
        self.assertIn("frame 1 failed", "\n".join(told.output))

    def test_files_are_cleaned_as_by_the_command_line(self):
        shot = self.folder / "shot.####.exr"
        for i, frame in enumerate(frames(), start=1):
            brume.write(self.folder / f"shot.{i:04}.exr", frame)
        run("denoise", shot, "--frames", "1-4", "-f", "transport_regression", "-o", self.folder / "cli.####.exr", "-q")
        end = brume.denoise(shot, "transport_regression", output=self.folder / "py.####.exr", png=self.folder / "py.####.png")
        self.assertEqual(end, {"done": [1, 2, 3, 4], "skipped": [], "failed": []})
        for n in range(1, 5):
            assert_same_pixels(self, brume.read(self.folder / f"py.{n:04}.exr"), brume.read(self.folder / f"cli.{n:04}.exr"))
            self.assertTrue((self.folder / f"py.{n:04}.png").exists())
        end = brume.denoise(shot, "transport_regression", output=self.folder / "py.####.exr", frame_numbers="2-3", resume=True)
        self.assertEqual((end["done"], end["skipped"]), ([], [2, 3]))
        one = brume.denoise(self.folder / "shot.0002.exr", "gaussian", output=self.folder / "one.exr")
        self.assertIsNone(one)
        assert_same_pixels(self, brume.read(self.folder / "one.exr"), brume.denoise(self.folder / "shot.0002.exr", "gaussian"))

    def test_a_file_of_another_renderer_comes_back_whole(self):
        rng = np.random.default_rng(4)
        passes = {name: rng.random((24, 32, 3), dtype=np.float32) for name in ("VolumeDir", "VolumeInd", "Emit")}
        passes["Combined"] = passes["VolumeDir"] + passes["VolumeInd"] + passes["Emit"]
        passes["CryptoObject00"] = rng.random((24, 32, 3), dtype=np.float32)
        channels = {f"ViewLayer.{name}.{c}": image[:, :, i] for name, image in passes.items() for i, c in enumerate("RGB")}
        foreign, out = self.folder / "cycles.exr", self.folder / "clean.exr"
        brume.write(foreign, brume.Layers(channels, header={"owner": "somebody"}))
        brume.denoise(foreign, "bilateral", output=out, samples=16)
        before, after = brume.read(foreign, adopt=False), brume.read(out, adopt=False)
        self.assertEqual(before.keys(), after.keys())
        changed = [name for name in before if not np.array_equal(before[name], after[name], equal_nan=True)]
        self.assertEqual({name.split(".")[1] for name in changed}, {"Combined", "VolumeDir", "VolumeInd", "Emit"})
        self.assertEqual(after.header["owner"], "somebody")
        run("denoise", foreign, "-f", "bilateral", "--samples", "16", "-o", self.folder / "cli.exr", "-q")
        assert_same_pixels(self, after, brume.read(self.folder / "cli.exr", adopt=False))
        brume.denoise(foreign, "bilateral", output=self.folder / "beside.exr", suffix="_clean", samples=16)
        beside = brume.read(self.folder / "beside.exr", adopt=False)
        self.assertGreater(len(beside), len(before))
        for name in before:
            np.testing.assert_array_equal(beside[name], before[name], name)

    def test_output_needs_files(self):
        with self.assertRaisesRegex(brume.InputError, "output: is for files; expected layers to be a path"):
            brume.denoise(np.zeros((4, 4, 3)), output=self.folder / "a.exr")
        with self.assertRaisesRegex(brume.InputError, "no file of that name is there"):
            brume.denoise(self.folder / "a.####.exr", output=self.folder / "b.####.exr")
        with self.assertRaisesRegex(brume.InputError, "all 2 frames would go into one file"):
            brume.denoise(self.folder / "a.####.exr", output=self.folder / "b.exr", frame_numbers="1-2")
        with self.assertRaisesRegex(brume.InputError, "resume leaves out"):
            brume.denoise(self.folder / "a.exr", output=self.folder / "b.exr", resume=True)


class Compare(Folder):
    def test_sequences_are_compared_as_by_the_command_line(self):
        shot, references = frames((1, 2, 3)), frames((1, 2, 3), seed=9)
        for i in range(3):
            brume.write(self.folder / f"a.{i}.exr", shot[i])
            brume.write(self.folder / f"r.{i}.exr", references[i])
        a, r = self.folder / "a.#.exr", self.folder / "r.#.exr"
        told = json.loads(run("compare", a, r, "--frames", "0-2", "--json", "-q"))
        found = brume.compare(a, r, frames="0-2", contact_sheet=self.folder / "sheet.png")
        self.assertEqual(found, told)
        self.assertTrue((self.folder / "sheet.png").exists())
        in_memory = brume.compare(shot, references)
        self.assertEqual((in_memory["metrics"], in_memory["frames"]), (told["metrics"], [0, 1, 2]))
        self.assertGreater(in_memory["metrics"]["flicker"], -1e9)
        with self.assertRaisesRegex(brume.InputError, "picture has 3|reference has 2 frames, picture has 3"):
            brume.compare(shot, references[:2])
        with self.assertRaisesRegex(brume.InputError, "frames: 2 numbers for 3 frames of picture"):
            brume.compare(shot, references, frames="1-2")
        with self.assertRaisesRegex(brume.InputError, "expected sequences of all of them"):
            brume.compare(shot, references[0])
        with self.assertRaisesRegex(brume.InputError, "has no place for a frame's number"):
            brume.compare(self.folder / "a.0.exr", r, frames="0-2")


if __name__ == "__main__":
    unittest.main()
