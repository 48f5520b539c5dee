"""Parts, checkpoints and merge: the same bits as one render in one go."""

import os
import pickle
import signal
import threading
import unittest

import numpy as np

import brume
from support import Folder, assert_same_pixels, run, small_scene

SCENE = small_scene()

ONE = {"spp": 7, "layers": "direct,indirect,guides"}


def most_samples(state):
    """Of any tile: a render that was interrupted in the middle of a pass has more in some than in others."""
    header = brume.read(state, "R").header
    return header.get("samplesPerPixelMost", header["samplesPerPixel"])


class Merge(Folder):
    def setUp(self):
        super().setUp()
        self.whole = brume.render(SCENE, **ONE)
        self.parts = [brume.render(SCENE, part=(i, 3), **ONE) for i in (1, 2, 3)]

    def test_parts_become_the_whole_in_memory_and_from_files(self):
        for i, part in enumerate(self.parts, start=1):
            brume.write(self.folder / f"part{i}.exr", part)
        last = self.folder / "part3.exr"
        for parts in (self.parts, [self.parts[2], self.folder / "part1.exr", self.parts[1]],
                      self.folder / "part#.exr", str(self.folder / "part#.exr"), [pickle.loads(pickle.dumps(p)) for p in self.parts],
                      (p.copy() for p in self.parts), [self.parts[0], self.parts[1], last]):
            merged = brume.merge(parts)
            assert_same_pixels(self, merged, self.whole)
            self.assertEqual(merged.header["samplesPerPixel"], 7)
        run("merge", self.folder / "part#.exr", "-o", self.folder / "cli.exr", "-q")
        assert_same_pixels(self, brume.read(self.folder / "cli.exr"), self.whole)

    def test_what_is_mergeable_can_be_merged_again(self):
        half = brume.merge(self.parts[:2], mergeable=True, output=self.folder / "half.exr")
        self.assertEqual(half.header["samplesPerPixel"], 4)
        for first in (half, self.folder / "half.exr"):
            assert_same_pixels(self, brume.merge([first, self.parts[2]]), self.whole)

    def test_what_are_no_parts_is_refused(self):
        other = brume.render(SCENE, part=(2, 3), seed=5, **ONE)
        for parts, words in (
            ([self.parts[0], self.parts[0]], "overlap: samples 0 .. 1 are in both"),
            ([self.parts[0], other], "not parts of one render: the seed is 5 in the first, 0 in the second"),
            ([self.whole], "holds no sums of its samples"),
            ([], "no parts"),
            (self.folder / "missing.exr", "missing.exr"),
            (self.folder / "none#.exr", "no file of that name is there"),
        ):
            with self.assertRaisesRegex(brume.InputError, words):
                brume.merge(parts)
        with self.assertRaisesRegex(TypeError, "expected Layers or paths, found int"):
            brume.merge([3])
        with self.assertRaisesRegex(brume.InputError, r"part \(4, 3\): expected \(i, n\)"):
            brume.render(SCENE, part=(4, 3), **ONE)
        brume.write(self.folder / "part1.exr", self.parts[0])
        with self.assertRaisesRegex(brume.InputError, "1 of 2 parts are not there: 2"):
            brume.merge(self.folder / "part#.exr", numbers="1-2")


class Checkpoints(Folder):
    def test_an_interrupted_render_goes_on_to_the_same_bits(self):
        state, scene = self.folder / "state.exr", brume.Scene(SCENE)
        with self.assertRaises(KeyboardInterrupt):
            scene.render(spp=1 << 20, checkpoint=state, progress=lambda f: os.kill(os.getpid(), signal.SIGINT))
        more = most_samples(state) + 5
        expected = brume.render(SCENE, spp=more)
        assert_same_pixels(self, scene.render(spp=more, resume=state), expected)
        assert_same_pixels(self, brume.render(SCENE, spp=more, resume=state), expected)

    def test_a_finished_checkpoint_is_a_part_that_takes_more_samples(self):
        state = self.folder / "state.exr"
        brume.render(SCENE, spp=3, checkpoint=state)
        assert_same_pixels(self, brume.render(SCENE, spp=5, resume=state), brume.render(SCENE, spp=5))
        with self.assertRaisesRegex(brume.InputError, "not parts of one render: camera.fov"):
            brume.render(SCENE, spp=5, resume=state, camera__fov=31.0)

    def test_time_and_target_error_end_a_render(self):
        # More samples than any machine takes in that time.
        frame = brume.render(SCENE, time=0.2)
        self.assertGreater(frame.header["samplesPerPixel"], 0)
        self.assertLess(frame.header["samplesPerPixel"], 1 << 20)
        loose = brume.render(SCENE, target_error=0.1)
        tight = brume.render(SCENE, target_error=0.02)
        self.assertLessEqual(tight.header["estimatedRelativeError"], 0.02)
        self.assertGreater(tight.header["samplesPerPixel"], loose.header["samplesPerPixel"])
        clean = brume.render(SCENE, target_error=0.05, clean=True)
        self.assertLessEqual(clean.header["estimatedCleanError"], 0.05)
        for keywords, words in (({"time": 0}, "time: expected a number above 0, found 0"),
                                ({"target_error": -1}, "target_error: expected a number above 0"),
                                ({"target_error": 0.1, "statistics": False}, "needs statistics"),
                                ({"resume": True}, "for the frames of a sequence"),
                                ({"checkpoint": self.folder / "a.exr", "checkpoint_every": 0}, "checkpoint_every"),
                                ({"checkpoint": self.folder / "a.png"}, "a.png")):
            with self.assertRaisesRegex(brume.InputError, words):
                brume.render(SCENE, **keywords)


class Pictures(unittest.TestCase):
    def test_pictures_come_while_samples_go_on_in_the_callers_thread(self):
        seen = []

        def look(layers, info):
            seen.append((threading.get_ident(), layers, info))
            if len(seen) == 3:
                raise StopIteration

        with self.assertRaises(StopIteration):
            brume.render(SCENE, spp=1 << 20, on_picture=look)
        self.assertEqual({thread for thread, _, _ in seen}, {threading.get_ident()})
        samples = [info["samples"] for _, _, info in seen]
        self.assertTrue(0 < samples[0] < samples[1] < samples[2], samples)
        for _, layers, info in seen:
            self.assertEqual(set(info), {"samples", "seconds", "clean", "error"})
            self.assertFalse(info["clean"])
            n = info["samples"]
            self.assertEqual(layers.header["samplesPerPixel"], n)
            assert_same_pixels(self, layers, brume.render(SCENE, spp=n))

    def test_clean_pictures_come_where_clean_is_set(self):
        seen = []

        def look(layers, info):
            seen.append((layers, info))
            if len(seen) == 2:
                raise StopIteration

        for ends in ({"spp": 1 << 20}, {"time": 1e6}):
            seen.clear()
            with self.assertRaises(StopIteration):
                brume.render(SCENE, clean=True, on_picture=look, **ends)
            layers, info = seen[-1]
            self.assertTrue(info["clean"] and "noisy.R" in layers)
            self.assertGreater(info["error"], 0)

    def test_watching_changes_no_bit_and_no_picture_is_made_while_one_is_looked_at(self):
        begun, done, inside = [], threading.Event(), []

        def look(layers, info):
            begun.append(info["samples"])
            inside.append(done.is_set())
            if len(begun) == 1:
                done.wait(1.0)  # as slow as a plot; the render goes on

        expected = brume.render(SCENE, spp=60, clean=True)
        found = brume.render(SCENE, spp=60, clean=True, on_picture=look)
        assert_same_pixels(self, found, expected)
        self.assertNotIn("adaptive", found.header)
        self.assertEqual(sorted(set(begun)), begun, "each picture is newer than the one before")

    def test_a_callback_that_raises_leaves_a_checkpoint(self):
        import tempfile
        with tempfile.TemporaryDirectory() as folder:
            state = os.path.join(folder, "state.exr")

            def refuse(layers, info):
                raise LookupError("enough")

            with self.assertRaisesRegex(LookupError, "enough"):
                brume.render(SCENE, spp=1 << 20, checkpoint=state, on_picture=refuse)
            n = most_samples(state)
            assert_same_pixels(self, brume.render(SCENE, spp=n + 2, resume=state),
                               brume.render(SCENE, spp=n + 2))


if __name__ == "__main__":
    unittest.main()
