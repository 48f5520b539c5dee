"""Unusual scenes: what is said of them, and that they render. And that the add-on leaves nothing behind. Runs inside Blender."""

import os
import shutil
import sys
import unittest

import addon_utils
import bpy
import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import addon_scene as scenes  # noqa: E402
from brume_blender import engine  # noqa: E402
from brume_blender.translate import translate  # noqa: E402

NAME = 'a "b" \\ \'c\' / .. 雲'


class Unusual(unittest.TestCase):
    def setUp(self):
        self._folder = scenes.folder()
        self.addCleanup(self._folder.cleanup)

    def path(self, name):
        return os.path.join(self._folder.name, name)

    def translated(self, **options):
        scene = bpy.context.scene
        bpy.context.view_layer.update()
        return translate(bpy.context.evaluated_depsgraph_get(), scene, self._folder.name, **options)

    def picture(self):
        frame = scenes.render(self.path("frame.exr"))
        self.assertEqual(scenes.leftovers(), [])
        return frame.layer("ViewLayer.Combined", "RGB")

    def test_a_world_alone_is_its_colour(self):
        scenes.new_scene(width=8, height=6)
        scenes.add_camera()
        scenes.add_sky((0.25, 0.5, 0.125, 1))
        np.testing.assert_allclose(self.picture(), np.broadcast_to([0.25, 0.5, 0.125], (6, 8, 3)), atol=1e-3)

    def test_names_may_be_anything(self):
        scenes.smoke_scene(width=16, height=12)
        plain = self.picture()
        scene = bpy.context.scene
        folder = self.path("of 'quotes' \" and 雲")
        os.mkdir(folder)
        file = os.path.join(folder, '雲 "1".vdb')
        shutil.copy(scenes.SMOKE, file)
        floor = bpy.data.objects["Floor"]
        for thing in (scene, bpy.data.objects["Smoke"], floor, floor.data, bpy.data.materials["Smoke"], scene.world):
            thing.name = NAME
        bpy.data.volumes[0].filepath = file
        bpy.ops.wm.save_as_mainfile(filepath=os.path.join(folder, '雲 "2".blend'))
        np.testing.assert_array_equal(self.picture(), plain)

    def test_what_is_scaled_to_nothing_is_not_seen_and_what_is_flat_stays_flat(self):
        scenes.smoke_scene(width=16, height=12)
        smoke, floor = bpy.data.objects["Smoke"], bpy.data.objects["Floor"]
        smoke.scale = floor.scale = (0, 0, 0)
        translation = self.translated()
        self.assertNotIn("[[volumes]]", translation.text)
        self.assertNotIn("[[surfaces]]", translation.text)
        self.assertEqual(translation.notes, [])
        smoke.scale, floor.scale = (1, 1, 0), (1, 1, 1)
        seen = self.picture()
        floor.scale = (1, 1, 0)
        np.testing.assert_allclose(self.picture(), seen, atol=1e-3)
        self.assertNotIn("[[volumes]]", self.translated().text)

    def test_what_grows_from_nothing_has_no_motion_blur(self):
        scene = scenes.smoke_scene(width=16, height=12)
        scene.render.use_motion_blur = True
        smoke = bpy.data.objects["Smoke"]
        for frame, size in ((0, 0), (1, 0), (2, 1)):
            smoke.scale = [size] * 3
            smoke.keyframe_insert("scale", frame=frame)
        scene.frame_set(1)
        self.assertNotIn("[[volumes]]", self.translated(set_frame=lambda f, s: scene.frame_set(f, subframe=s)).text)
        smoke.keyframe_insert("location", frame=1)
        smoke.location.x = 1
        smoke.keyframe_insert("location", frame=2)
        for curve in smoke.animation_data.action.fcurves:
            for key in curve.keyframe_points:
                key.interpolation = "CONSTANT" if curve.data_path == "scale" else "LINEAR"
        scene.frame_set(2)
        translation = self.translated(set_frame=lambda f, s: scene.frame_set(f, subframe=s))
        self.assertIn("[[volumes]]", translation.text)
        self.assertNotIn("object_to_world_end", translation.text)
        self.assertIn(
            "Smoke: is scaled to nothing while the shutter is open, which is left out of the motion blur", translation.notes
        )

    def test_a_volume_without_a_material_is_shaded_by_its_density(self):
        scenes.smoke_scene()
        bpy.data.volumes[0].materials.clear()
        self.assertEqual(
            self.translated().notes,
            [
                "Smoke: the volume is left out: it has no material, and its file no grid 'density'; "
                "it has: density_noise, flame_noise"
            ],
        )

    def test_notes_are_lines(self):
        scenes.smoke_scene()
        bpy.data.objects["Smoke"].name = "over\ntwo"
        bpy.data.volumes[0].filepath = ""
        self.assertEqual(self.translated().notes, ["over two: the volume is left out: it has no file"])


class AddOn(unittest.TestCase):
    def test_disabling_leaves_nothing_behind(self):
        def offered():
            return {p.__name__ for p in bpy.types.Panel.__subclasses__() if "BRUME" in getattr(p, "COMPAT_ENGINES", ())}

        scene = scenes.new_scene()
        self.assertTrue(offered())
        for _ in range(2):
            addon_utils.disable("brume_blender", default_set=True)
            self.assertEqual(offered(), set())
            self.assertFalse(hasattr(bpy.types.Scene, "brume") or hasattr(bpy.types.ViewLayer, "brume"))
            self.assertEqual([name for name in dir(bpy.types) if "brume" in name.lower()], [])
            self.assertNotIn(engine.forget_what_was_said, bpy.app.handlers.render_init)
            self.assertNotEqual(scene.render.engine, "BRUME")
            addon_utils.enable("brume_blender", default_set=True)
            scene.render.engine = "BRUME"
            self.assertEqual(scene.brume.samples, 4, "what was set comes back")


if __name__ == "__main__":
    scenes.run_tests(sys.modules[__name__])
