"""Files of Volume objects as the translation reads them, against Blender's own reading. Runs inside Blender."""

import os
import re
import shutil
import sys
import unittest

import bpy
import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import addon_scene as scenes  # noqa: E402
from brume_blender.translate import CannotTranslate, translate, vdb_header, volumes  # noqa: E402
from brume_blender.translate.notes import LeftOut  # noqa: E402

TYPES = {"float": "FLOAT", "vec3s": "VECTOR_FLOAT"}


class Volumes(unittest.TestCase):
    def setUp(self):
        scenes.new_scene()
        self._folder = scenes.folder()
        self.addCleanup(self._folder.cleanup)

    def test_grids_and_their_types_are_blenders(self):
        data = os.path.join(scenes.SOURCE, "data", "volumes")
        found = [name for name in os.listdir(data) if name.endswith(".vdb")]
        self.assertGreaterEqual(len(found), 3)
        for name in found:
            volume = bpy.data.volumes.new(name)
            volume.filepath = os.path.join(data, name)
            volume.grids.load()
            theirs = {grid.name: grid.data_type for grid in volume.grids}
            ours = {grid: TYPES.get(kind, kind) for grid, kind in vdb_header.grids(volume.filepath).items()}
            self.assertEqual(ours, theirs, name)

    def test_boxes_and_voxel_sizes_are_blenders(self):
        """Blender's boxes are those of whole leaves of 8 voxels."""
        for name in ("smoke.vdb", "fire.vdb", "cloud.vdb"):
            volume = bpy.data.volumes.new(name)
            volume.filepath = os.path.join(scenes.SOURCE, "data", "volumes", name)
            volume.grids.load()
            thing = scenes.link(name, volume)
            bpy.context.view_layer.update()
            shown = thing.evaluated_get(bpy.context.evaluated_depsgraph_get())
            theirs = np.array([corner[:] for corner in shown.bound_box])
            boxes, sizes = vdb_header.boxes(volume.filepath), vdb_header.voxel_sizes(volume.filepath)
            for grid in volume.grids:
                np.testing.assert_allclose(sizes[grid.name], grid.matrix_object[0][0], rtol=1e-6)
            size = max(sizes.values())
            ours = np.concatenate(list(boxes.values()))
            self.assertTrue(np.all(ours.min(0) > theirs.min(0) - size) and np.all(ours.max(0) < theirs.max(0) + size), name)
            self.assertTrue(np.all(ours.min(0) < theirs.min(0) + 8 * size) and np.all(ours.max(0) > theirs.max(0) - 8 * size), name)

    def test_a_volume_that_the_camera_clips_is_said(self):
        scenes.smoke_scene(floor=False)
        translation = self._translated()
        self.assertEqual(translation.notes, [])
        bpy.context.scene.camera.data.clip_end = 5
        self.assertIn("Smoke: is seen beyond 5, where Blender's camera clips", "\n".join(self._translated().notes))

    def test_what_rays_see_no_volume_is_said(self):
        scenes.smoke_scene(floor=False)
        smoke = bpy.data.objects["Smoke"]
        smoke.visible_shadow = False
        self.assertEqual(self._translated().notes, ["Smoke: its volume is seen by rays of every kind in brume, shadow too"])
        smoke.visible_shadow, smoke.is_holdout = True, True
        translation = self._translated()
        self.assertEqual(translation.notes, [])
        self.assertIn('role = "holdout"', translation.text)
        smoke.is_holdout = False
        self.assertNotIn("role", self._translated().text)
        collection = bpy.data.collections.new("Unseen")
        bpy.context.scene.collection.children.link(collection)
        bpy.context.scene.collection.objects.unlink(smoke)
        collection.objects.link(smoke)
        bpy.context.view_layer.layer_collection.children["Unseen"].indirect_only = True
        self.assertEqual(self._translated().notes, ["Smoke: its volume is seen by rays of every kind in brume, camera too"])

    def test_a_scaled_volume_is_as_dense_as_its_space_says(self):
        scenes.smoke_scene(floor=False)
        smoke, sigma = bpy.data.objects["Smoke"], {}
        for space, scale in (("OBJECT", (1, 1, 1)), ("OBJECT", (2, 2, 2)), ("OBJECT", (1, 1, 3)), ("WORLD", (1, 1, 3))):
            smoke.scale, smoke.data.render.space = scale, space
            bpy.context.view_layer.update()
            found = re.search(r"sigma_s = \[([^,]+),", self._translated().text)
            sigma[space, scale] = float(found[1])
        plain = sigma["OBJECT", (1, 1, 1)]
        self.assertAlmostEqual(sigma["OBJECT", (2, 2, 2)] / plain, 0.5, 5)
        self.assertAlmostEqual(sigma["OBJECT", (1, 1, 3)] / plain, (3 / 11) ** 0.5, 5, "as Cycles 3.4 renders it")
        self.assertAlmostEqual(sigma["WORLD", (1, 1, 3)] / plain, 1, 6)

    def test_a_missing_file_is_an_error_and_one_of_a_sequence_is_left_out(self):
        path = os.path.join(self._folder.name, "gone_001.vdb")
        scenes.smoke_scene(width=16, height=12, path=path)
        with self.assertRaises(RuntimeError) as raised:
            scenes.render(os.path.join(self._folder.name, "a.exr"))
        self.assertIn(f"Smoke: its file {path} is not there", str(raised.exception))
        with self.assertRaises(CannotTranslate):
            self._translated()
        self.assertEqual(os.listdir(self._folder.name), [], "the floor's mesh has gone")
        volume = bpy.data.volumes[0]
        volume.is_sequence, volume.frame_duration = True, 1
        translation = self._translated()
        self.assertEqual(translation.notes, [f"Smoke: the volume is left out: its file {path} is not there"])
        self.assertEqual(translation.volumes, 0)

    def _translated(self):
        return translate(bpy.context.evaluated_depsgraph_get(), bpy.context.scene, self._folder.name)

    def test_files_of_sequences_are_blenders(self):
        for number in range(1, 9):
            shutil.copy(scenes.SMOKE, os.path.join(self._folder.name, f"a.v2_{number:03}.vdb"))
        volume = scenes.add_smoke(os.path.join(self._folder.name, "a.v2_002.vdb")).data
        volume.is_sequence = True
        scene = bpy.context.scene
        tested = set()
        for mode in ("CLIP", "EXTEND", "REPEAT", "PING_PONG"):
            for start, count, offset in ((1, 4, 0), (3, 5, 2), (-2, 2, 1), (5, 3, -4)):
                volume.sequence_mode = mode
                volume.frame_start, volume.frame_duration, volume.frame_offset = start, count, offset
                for frame in range(-6, 16):
                    scene.frame_set(frame)
                    shown = volume.evaluated_get(bpy.context.evaluated_depsgraph_get())
                    shown.grids.load()
                    theirs = shown.grids.frame_filepath
                    try:
                        ours = volumes.path_of(volume, frame)
                    except LeftOut:
                        ours = ""
                    if not os.path.exists(ours):  # which Blender shows as nothing
                        ours = ""
                    self.assertEqual(ours, theirs, (mode, start, count, offset, frame))
                    tested.add(ours)
        self.assertGreaterEqual(len(tested), 8)

    def test_stretched_time_shows_blenders_file(self):
        for number in range(1, 9):
            shutil.copy(scenes.SMOKE, os.path.join(self._folder.name, f"a_{number:03}.vdb"))
        scenes.smoke_scene(floor=False, path=os.path.join(self._folder.name, "a_001.vdb"))
        volume, scene = bpy.data.objects["Smoke"].data, bpy.context.scene
        volume.is_sequence, volume.frame_duration, volume.frame_start, volume.sequence_mode = True, 8, 1, "EXTEND"
        for old, new in ((100, 100), (100, 50), (100, 200), (70, 100)):
            scene.render.frame_map_old, scene.render.frame_map_new = old, new
            for frame in range(1, 10):
                scene.frame_set(frame)
                shown = volume.evaluated_get(bpy.context.evaluated_depsgraph_get())
                shown.grids.load()
                self.assertIn(f'file = "{shown.grids.frame_filepath}"', self._translated().text, (old, new, frame))

    def test_a_file_that_cannot_be_read_is_for_the_program_to_say(self):
        with open(scenes.SMOKE, "rb") as file:
            data = file.read()
        path = os.path.join(self._folder.name, "bad.vdb")
        scenes.smoke_scene(width=16, height=12, path=path)
        for content in (b"", b"no volume at all", data[:3000], data[:-100], data[:700] + b"\xff" * 300 + data[1000:]):
            with open(path, "wb") as file:
                file.write(content)
            with self.assertRaises(RuntimeError) as raised:
                scenes.render(os.path.join(self._folder.name, "a.exr"))
            self.assertIn("bad.vdb", str(raised.exception))


if __name__ == "__main__":
    scenes.run_tests(sys.modules[__name__])
