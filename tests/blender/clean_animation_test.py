"""Cleaning an animation of Cycles, in Blender without a window."""

import hashlib
import os
import shutil
import sys
import unittest

import bpy
import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import addon_scene as scenes  # noqa: E402
from brume_blender import child, sequence_cleaning  # noqa: E402
from addon_scene import exr  # noqa: E402

FRAMES = 3
CHANNELS = ("Combined", "VolumeDir", "VolumeInd", "Env", "DiffDir", "DiffInd", "DiffCol")


def shot(folder, samples=4):
    """Three frames of smoke with a moving lamp, rendered by Cycles with all of its passes."""
    scene = scenes.smoke_scene("CYCLES")
    lamp = bpy.data.objects["Lamp"]
    for frame, x in ((1, 2), (FRAMES, -2)):
        lamp.location.x = x
        lamp.keyframe_insert("location", frame=frame)
    scenes.all_passes(bpy.context.view_layer)
    layer = bpy.context.view_layer
    layer.cycles.use_pass_volume_direct = layer.cycles.use_pass_volume_indirect = True
    scene.cycles.samples, scene.cycles.volume_bounces = samples, 16
    scene.frame_start, scene.frame_end = 1, FRAMES
    scene.render.filepath = os.path.join(folder, "shot_####.exr")
    bpy.ops.render.render(animation=True)
    return scene


class CleanAnimation(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls._rendered = scenes.folder()
        shot(cls._rendered.name)
        bpy.ops.wm.save_as_mainfile(filepath=os.path.join(cls._rendered.name, "shot.blend"), relative_remap=False)
        cls.addClassCleanup(cls._rendered.cleanup)

    def setUp(self):
        folder = scenes.folder()
        self.addCleanup(folder.cleanup)
        self.folder = os.path.join(folder.name, "shot")
        shutil.copytree(self._rendered.name, self.folder)
        bpy.ops.wm.open_mainfile(filepath=os.path.join(self.folder, "shot.blend"))
        self.scene = bpy.context.scene
        self.scene.render.filepath = self.path("shot_####.exr")

    def path(self, name):
        return os.path.join(self.folder, name)

    def frame(self, number, suffix=""):
        return exr.read(self.path(f"shot{suffix}_{number:04}.exr"))

    def contents(self):
        """Every file of the folder, by its bytes' digest."""
        found = {}
        for name in sorted(os.listdir(self.folder)):
            with open(self.path(name), "rb") as file:
                found[name] = hashlib.sha256(file.read()).hexdigest()
        return found

    def options(self, **changed):
        pattern = sequence_cleaning.pattern_of(self.scene.render.filepath)
        return sequence_cleaning.Options(**{"pattern": pattern, "frames": [1, 2, 3], "suffix": "_clean", **changed})

    def steps(self, **changed):
        return sequence_cleaning.clean(self.scene, bpy.context.view_layer, self.options(**changed))

    def problem_of(self, **changed):
        before = self.contents()
        with self.assertRaises((sequence_cleaning.Problem, child.CannotStart)) as raised:
            for _ in self.steps(**changed):
                pass
        self.assertEqual(self.contents(), before)
        self.assertEqual([n for n in os.listdir(bpy.app.tempdir) if n.startswith(".brume")], [])
        return str(raised.exception)

    def test_every_channel_comes_back_and_the_light_is_clean(self):
        self.scene.frame_set(2)
        self.assertEqual(bpy.ops.brume.clean_animation(), {"FINISHED"})
        self.assertEqual(self.scene.frame_current, 2)
        self.scene.cycles.samples, self.scene.cycles.seed = 256, 7
        reference = scenes.render(self.path("reference.exr"))
        for number in range(1, FRAMES + 1):
            noisy, clean = self.frame(number), self.frame(number, "_clean")
            self.assertEqual(sorted(noisy.channels), sorted(clean.channels))
            changed = {name.rsplit(".", 1)[0] for name in noisy.channels if (noisy.channels[name] != clean.channels[name]).any()}
            self.assertLessEqual({"ViewLayer.Combined", "ViewLayer.VolumeDir", "ViewLayer.VolumeInd"}, changed)
            self.assertTrue(changed.isdisjoint({"ViewLayer.Depth", "ViewLayer.Normal", "ViewLayer.DiffCol", "ViewLayer.Position"}))
            if number == 2:
                errors = [np.sqrt(np.mean((f.layer("ViewLayer.VolumeDir", "RGB") - reference.layer("ViewLayer.VolumeDir", "RGB")) ** 2))
                          for f in (noisy, clean)]  # fmt: skip
                self.assertLess(errors[1], 0.4 * errors[0])
        self.assertEqual([name for name in os.listdir(self.folder) if name.startswith(".")], [])

    def test_without_a_suffix_the_files_are_replaced(self):
        before = self.contents()
        bpy.ops.brume.clean_animation(suffix="", start=2, end=3)
        after = self.contents()
        self.assertEqual(sorted(before), sorted(after))
        self.assertEqual({name for name in before if before[name] != after[name]}, {"shot_0002.exr", "shot_0003.exr"})

    def test_frames_that_lie_in_several_chunks_come_out_as_in_one(self):
        bpy.ops.brume.clean_animation()
        at_once = self.contents()
        chunk, sequence_cleaning.CHUNK = sequence_cleaning.CHUNK, 1
        try:
            bpy.ops.brume.clean_animation()
        finally:
            sequence_cleaning.CHUNK = chunk
        for number in range(1, FRAMES + 1):
            one, two = self.contents(), at_once
            self.assertEqual(one[f"shot_clean_{number:04}.exr"], two[f"shot_clean_{number:04}.exr"])

    def test_cancelling_leaves_the_files_as_they_were(self):
        before = self.contents()
        for until in ("guides of frame 1", "guides of frame 3", "cleaning frames 1 to 3"):
            steps = self.steps(suffix="")
            for _, what in steps:
                if what == until:
                    break
            else:
                self.fail(f"no step '{until}'")
            steps.close()
            self.assertEqual(self.contents(), before, until)
            self.assertEqual([n for n in os.listdir(bpy.app.tempdir) if n.startswith(".brume")], [])

    def test_says_what_is_wrong_before_it_begins(self):
        os.remove(self.path("shot_0002.exr"))
        problem = self.problem_of()
        self.assertIn("shot_0002.exr is not there", problem)
        self.assertIn("MultiLayer", problem)
        self.assertIn("####", self.problem_of(pattern=self.path("shot.exr")))
        self.assertIn("from 0", self.problem_of(frames=[-1, 0]))
        self.assertIn("no frames", self.problem_of(frames=[]))
        self.assertIn("which is no program", self.program_problem())

    def program_problem(self):
        from brume_blender import program

        with self.assertRaises(program.NoProgram) as raised:
            list(self.steps(program="/nowhere/brume", frames=[1]))
        return str(raised.exception)

    def test_says_what_the_program_says(self):
        self.assertIn("nfor", self.problem_of(filter="nforr"))
        with open(self.path("shot_0002.exr"), "wb") as file:
            file.write(b"no picture")
        self.assertIn("shot_0002.exr", self.problem_of())

    def test_a_scene_without_a_volume_has_no_guides(self):
        bpy.data.objects.remove(bpy.data.objects["Smoke"])
        self.assertIn("no volume", self.problem_of())

    def test_names_are_blenders(self):
        pattern = sequence_cleaning.pattern_of
        self.assertEqual(pattern("/a/shot_###"), "/a/shot_###.exr")
        self.assertEqual(pattern("/a/shot"), "/a/shot####.exr")
        self.assertEqual(pattern("/a/"), "/a/####.exr")
        for path in ("/a/shot_###", "/a/shot", "/a/", "/a/x.exr", "/a/v1.2_"):
            self.scene.render.filepath = path
            self.assertEqual(sequence_cleaning.file_of(pattern(path), 12), self.scene.render.frame_path(frame=12))
        self.assertEqual(sequence_cleaning.clean_name("/a/shot_####.exr", "_clean"), "/a/shot_clean_####.exr")
        self.assertEqual(sequence_cleaning.clean_name("/a/####.exr", "_clean"), "/a/_clean####.exr")
        self.assertEqual(sequence_cleaning.clean_name("/a.#/shot.####.exr", "_c"), "/a.#/shot_c.####.exr")


if __name__ == "__main__":
    scenes.run_tests(sys.modules[__name__])
