"""F12 with brume, in Blender without a window: pictures, passes, borders, view layers, limits, errors."""

import os
import subprocess
import sys
import unittest

import bpy
import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import addon_scene as scenes  # noqa: E402
from brume_blender import engine, passes, presets, properties, window  # noqa: E402
from addon_scene import exr  # noqa: E402

BROKEN = os.path.join(scenes.SOURCE, "data", "README.md")  # no OpenVDB file


class EngineTest(unittest.TestCase):
    def setUp(self):
        self._folder = scenes.folder()
        self.addCleanup(self._folder.cleanup)

    def path(self, name):
        return os.path.join(self._folder.name, name)

    def render(self, name="frame.exr"):
        return scenes.render(self.path(name))

    def error_of(self, function=None):
        """What Blender reports of a render that fails."""
        with self.assertRaises(RuntimeError) as raised:
            (function or self.render)()
        self.assertEqual(scenes.leftovers(), [])
        return str(raised.exception)

    def layer(self, frame, name, components="RGB", view_layer="ViewLayer"):
        found = frame.layer(f"{view_layer}.{name}", components)
        self.assertIsNotNone(found, f"{name}: {sorted(frame.channels)}")
        return found


class Pictures(EngineTest):
    def test_the_picture_is_the_programs_to_the_last_bit(self):
        """The scene as translated, rendered by the program alone."""
        scene = scenes.smoke_scene()
        kept = self.path("kept")
        words = []
        original = engine.Child

        class Keeping(original):
            def __init__(self, program, arguments, folder=None):
                words[:] = [str(word) for word in arguments]
                os.rename(os.path.dirname(words[1]), kept)
                os.symlink(kept, os.path.dirname(words[1]))
                super().__init__(program, arguments, folder)

        engine.Child = Keeping
        try:
            rendered = self.render()
        finally:
            engine.Child = original
        words = [word.replace(os.path.dirname(words[1]), kept) for word in words]
        words[words.index("-o") + 1] = self.path("alone.exr")
        subprocess.run([os.environ["BRUME_PROGRAM"], *words, "-q"], check=True, stdout=subprocess.DEVNULL)
        alone = exr.read(self.path("alone.exr"))
        np.testing.assert_array_equal(self.layer(rendered, "Combined"), alone.layer("", "RGB"))
        self.assertGreater(alone.layer("", "RGB").std(), 0.01)
        self.assertTrue((self.layer(rendered, "Combined", "A") == 1).all(), "the film is not transparent")
        self.assertEqual(scene.brume.samples, alone.header["samplesPerPixel"])

    def test_pictures_are_shown_while_it_renders(self):
        scenes.smoke_scene()
        shown = []
        original = engine._Frame._show_picture

        def show(self, frame):
            shown.append(frame.layer("", "RGB").mean())
            original(self, frame)

        engine._Frame._show_picture = show
        try:
            last = self.render()
        finally:
            engine._Frame._show_picture = original
        self.assertGreaterEqual(len(shown), 1)
        self.assertAlmostEqual(shown[0], self.layer(last, "Combined").mean(), delta=0.1 * shown[0])

    def test_a_border_has_the_pixels_of_the_whole(self):
        scene = scenes.smoke_scene()
        scene.brume.use_clean = False  # a filter knows what is around a pixel
        whole = self.layer(self.render(), "Combined", "RGBA")
        render = scene.render
        render.use_border = True
        render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.31, 0.77, 0.2, 0.9
        place = window.window_of(render, 96, 72)
        inside = whole[place.y0 : place.y1, place.x0 : place.x1]
        self.assertGreater(inside.std(), 0.01)
        render.use_crop_to_border = True
        np.testing.assert_array_equal(self.layer(self.render(), "Combined", "RGBA"), inside)
        render.use_crop_to_border = False
        uncropped = self.layer(self.render(), "Combined", "RGBA")
        self.assertEqual(uncropped.shape, whole.shape)
        np.testing.assert_array_equal(uncropped[place.y0 : place.y1, place.x0 : place.x1], inside)
        outside = np.ones(whole.shape[:2], bool)
        outside[place.y0 : place.y1, place.x0 : place.x1] = False
        self.assertTrue((uncropped[outside] == 0).all())

    def test_borders_have_blenders_own_size_wherever_they_lie(self):
        scene = scenes.smoke_scene(width=83, height=61, floor=False)
        scene.brume.samples, scene.brume.use_clean = 1, False
        render = scene.render
        render.use_border = render.use_crop_to_border = True
        rng = np.random.default_rng(3)
        for _ in range(6):
            x, y = np.sort(rng.random(2)), np.sort(rng.random(2))
            render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = x[0], x[1] + 0.03, y[0], y[1] + 0.03
            frame = self.render()  # fails where the engine and Blender differ in a pixel
            place = window.window_of(render, 83, 61)
            self.assertEqual((frame.width, frame.height), (place.width, place.height))

    def test_percentage_and_pixel_aspect_give_blenders_size_and_view(self):
        scene = scenes.smoke_scene(width=101, height=57)
        scene.brume.use_clean = False
        scene.render.resolution_percentage = 57
        frame = self.render()
        self.assertEqual((frame.width, frame.height), (57, 32))
        scene.render.resolution_percentage = 100
        scene.brume.samples = 64
        square = self.layer(self.render(), "Combined")
        scene.render.resolution_x, scene.render.pixel_aspect_x = 50, 2.02  # the same view in half as many columns
        wide = self.layer(self.render(), "Combined")
        self.assertEqual(wide.shape[:2], (57, 50))
        halves = square[:, :100].reshape(57, 50, 2, 3).mean(axis=2)
        blocks = [a[:56, :48].reshape(14, 4, 12, 4, 3).mean(axis=(1, 3)) for a in (halves, wide)]
        np.testing.assert_allclose(blocks[0], blocks[1], rtol=0.1, atol=0.02)

    def test_film_transparent_leaves_the_sky_out_and_tells_the_share(self):
        scene = scenes.smoke_scene(floor=False)
        opaque = self.render()
        scene.render.film_transparent = True
        scenes.all_passes(bpy.context.view_layer)
        frame = self.render()
        alpha = self.layer(frame, "Combined", "A")
        self.assertLess(np.median(alpha), 1e-4, "most of the picture is sky")
        self.assertGreater(alpha.max(), 0.5)
        self.assertTrue((self.layer(frame, "Env") == 0).all())
        over_sky = self.layer(frame, "Combined") + (1 - alpha) * np.array([0.3, 0.4, 0.6])
        self.assertLess(np.sqrt(np.mean((over_sky - self.layer(opaque, "Combined")) ** 2)), 0.01)
        scene.brume.use_clean = False  # the same paths then
        frame = self.render()
        over_sky = self.layer(frame, "Combined") + (1 - self.layer(frame, "Combined", "A")) * np.array([0.3, 0.4, 0.6])
        scene.render.film_transparent = False
        np.testing.assert_allclose(over_sky, self.layer(self.render(), "Combined"), atol=1e-5)

    def test_alpha_is_as_clean_as_the_picture(self):
        scene = scenes.smoke_scene(floor=False)
        scene.render.film_transparent = True
        clean = self.layer(self.render(), "Combined", "A")
        scene.brume.use_clean = False
        noisy = self.layer(self.render(), "Combined", "A")
        scene.brume.samples, scene.brume.seed = 256, 1
        exact = self.layer(self.render(), "Combined", "A")
        self.assertLess(np.sqrt(np.mean((clean - exact) ** 2)), 0.25 * np.sqrt(np.mean((noisy - exact) ** 2)))

    def test_view_layers_are_rendered_each_with_its_collections(self):
        scene = scenes.smoke_scene()
        floor = bpy.data.objects["Floor"]
        collection = bpy.data.collections.new("Floors")
        scene.collection.children.link(collection)
        scene.collection.objects.unlink(floor)
        collection.objects.link(floor)
        bare = scene.view_layers.new("Bare")
        bare.layer_collection.children["Floors"].exclude = True
        bare.use_pass_z = True
        frame = self.render()
        self.assertNotIn("ViewLayer.Depth.Z", frame.channels)
        self.assertTrue((self.layer(frame, "Depth", "Z", "Bare") == passes.NOTHING).all())
        difference = np.abs(self.layer(frame, "Combined") - self.layer(frame, "Combined", view_layer="Bare")).max(axis=-1)
        self.assertGreater(difference[60:].mean(), 0.05, "the floor")
        self.assertLess(difference[:10].max(), 0.05, "the sky above it")


class Passes(EngineTest):
    def test_passes_have_cycles_names_and_add_up(self):
        scenes.smoke_scene()
        scenes.all_passes(bpy.context.view_layer)
        for clean in (True, False):
            with self.subTest(clean=clean):
                bpy.context.scene.brume.use_clean = clean
                frame = self.render()
                parts = {name: self.layer(frame, name) for name in passes.NAMES_SINCE_5}
                total = (parts["DiffDir"] + parts["DiffInd"]) * parts["DiffCol"]
                total = total + parts["VolumeDir"] + parts["VolumeInd"] + parts["Emit"] + parts["Env"]
                np.testing.assert_allclose(total, self.layer(frame, "Combined"), rtol=1e-5, atol=2e-6)
                for name in ("DiffDir", "DiffInd", "VolumeDir", "VolumeInd", "Env"):
                    self.assertGreater(parts[name].mean(), 0.001, name)
                self.assertEqual(parts["Emit"].max(), 0)
                np.testing.assert_allclose(parts["DiffCol"][-1], np.tile([0.5, 0.4, 0.3], (96, 1)), rtol=1e-5)

    def test_what_surfaces_show_is_as_cycles_has_it(self):
        """Depth, normal, position, colour and sky of a scene without a medium, where both renderers are exact."""
        scene = scenes.new_scene()
        scenes.add_camera(rotation=(1.3, 0, 0.1))
        scenes.add_floor()
        scenes.add_lamp()
        scenes.add_sky()
        bpy.ops.mesh.primitive_uv_sphere_add(radius=0.8, location=(0.3, 0, 0.8))
        bpy.context.object.data.materials.append(bpy.data.objects["Floor"].data.materials[0])
        scenes.all_passes(bpy.context.view_layer)
        scene.brume.use_clean = False
        scene.brume.samples = 16
        ours = self.render()
        scene.render.engine, scene.cycles.samples = "CYCLES", 16
        scene.cycles.pixel_filter_type = "BOX"
        theirs = self.render()
        for name, components in (("Depth", "Z"), ("Normal", "XYZ"), ("DiffCol", "RGB"), ("Env", "RGB"), ("DiffDir", "RGB")):
            a, b = self.layer(ours, name, components), self.layer(theirs, name, components)
            edge = np.ptp(self.layer(ours, "Depth", "Z"), axis=-1)
            depth = self.layer(ours, "Depth", "Z")[..., 0]
            inner = np.ones(depth.shape, bool)
            for dy in (-1, 0, 1):
                for dx in (-1, 0, 1):
                    inner &= np.abs(np.roll(depth, (dy, dx), (0, 1)) - depth) < 0.4
            self.assertGreater(inner.mean(), 0.5, edge.shape)
            error = np.abs(a - b)[inner]
            self.assertLess(error.mean(), 0.03 * max(np.abs(b[inner]).mean(), 0.1), name)

    def test_further_layers_are_passes_of_their_names(self):
        scenes.smoke_scene()
        bpy.context.view_layer.brume.layers = "coverage, gradient,sample_count , clean_error"
        bpy.context.view_layer.brume.use_pass_noisy = True
        frame = self.render()
        self.assertGreater(self.layer(frame, "coverage", "A").max(), 0.5)
        self.assertGreater(np.abs(self.layer(frame, "gradient", "XYZ")).max(), 0.5)
        self.assertTrue((self.layer(frame, "sample_count", "Y") == 4).all())
        self.assertGreater(self.layer(frame, "clean_error", "Y").max(), 0)
        noise = np.abs(self.layer(frame, "Noisy Image") - self.layer(frame, "Combined")).mean()
        self.assertGreater(noise, 0.001)

    def test_every_layer_that_the_panel_offers_exists(self):
        scene = scenes.smoke_scene(width=16, height=12)
        scene.brume.samples = 1
        names = [*passes.LAYERS, "sample_count"]
        bpy.context.view_layer.brume.layers = ",".join(names)
        frame = self.render()
        for name in names:
            self.layer(frame, name, {**passes.LAYERS, **passes.GIVEN}[name])

    def test_an_unknown_layer_is_named_with_those_there_are(self):
        scenes.smoke_scene()
        bpy.context.view_layer.brume.layers = "coverage, gradeint"
        error = self.error_of()
        self.assertIn("no layer 'gradeint'", error)
        self.assertIn("gradient", error)

    def test_passes_that_are_lacking_are_said_once_for_each_view_layer(self):
        scene = scenes.smoke_scene(width=16, height=12)
        scene.brume.samples = 1
        first, second = bpy.context.view_layer, scene.view_layers.new("Second")
        first.use_pass_object_index = first.use_pass_ambient_occlusion = True
        first.cycles.denoising_store_passes = True
        second.use_pass_material_index = True
        second.aovs.add().name = "Mask"
        scene.frame_start, scene.frame_end = 1, 2
        scene.render.filepath = self.path("shot_####")
        engine.forget_what_was_said()
        bpy.ops.render.render(animation=True)
        said = sorted(text for text in engine.Said.texts if "has no pass" in text)
        self.assertEqual(said, [
            "View layer Second: brume has no pass IndexMA, Mask (AOV); there is none in the result",
            "View layer ViewLayer: brume has no pass AO, IndexOB, Denoising Data; there is none in the result",
        ])  # fmt: skip

    def test_exposure_of_the_film_is_a_factor_on_light_alone(self):
        scene = scenes.smoke_scene(width=16, height=12)
        scene.brume.samples, scene.brume.use_clean = 2, False
        scenes.all_passes(bpy.context.view_layer)
        before = self.render()
        scene.cycles.film_exposure = 3
        after = self.render()
        for name in ("Combined", "DiffDir", "DiffInd", "VolumeDir", "VolumeInd", "Env"):
            np.testing.assert_allclose(self.layer(after, name), 3 * self.layer(before, name), rtol=1e-5, atol=1e-7, err_msg=name)
        for name, components in (("DiffCol", "RGB"), ("Depth", "Z"), ("Normal", "XYZ"), ("Combined", "A")):
            np.testing.assert_array_equal(self.layer(after, name, components), self.layer(before, name, components))

    def test_cycles_own_settings_ask_for_volume_passes(self):
        scenes.smoke_scene()
        bpy.context.view_layer.cycles.use_pass_volume_direct = True
        self.assertIn("VolumeDir", [p.name for p in properties.wanted_passes(bpy.context.view_layer)[0]])

    def test_a_compositor_gets_the_passes_by_cycles_names(self):
        """A node tree that adds up Cycles' passes makes the picture."""
        scene = scenes.smoke_scene()
        scenes.all_passes(bpy.context.view_layer)
        scene.use_nodes = True
        tree = scene.node_tree
        tree.nodes.clear()
        layers = tree.nodes.new("CompositorNodeRLayers")
        composite = tree.nodes.new("CompositorNodeComposite")

        def combine(kind, a, b):
            node = tree.nodes.new("CompositorNodeMixRGB")
            node.blend_type = kind
            tree.links.new(a, node.inputs[1])
            tree.links.new(b, node.inputs[2])
            return node.outputs[0]

        out = layers.outputs
        total = combine("MULTIPLY", combine("ADD", out["DiffDir"], out["DiffInd"]), out["DiffCol"])
        for name in ("VolumeDir", "VolumeInd", "Emit", "Env"):
            total = combine("ADD", total, out[name])
        tree.links.new(total, composite.inputs["Image"])
        frame = self.render()
        np.testing.assert_allclose(
            frame.layer("Composite.Combined", "RGB"), self.layer(frame, "Combined"), rtol=2e-3, atol=2e-3
        )


class Settings(EngineTest):
    def arguments(self):
        """What the program would be called with."""
        found = []

        class Recording:
            def __init__(self, program, arguments, folder=None):
                found[:] = [str(word) for word in arguments]
                raise engine.CannotStart("recorded")

        original, engine.Child = engine.Child, Recording
        try:
            self.assertIn("recorded", self.error_of())
        finally:
            engine.Child = original
        return " ".join(found)

    def test_settings_reach_the_program(self):
        scene = scenes.smoke_scene()
        own = scene.brume
        self.assertIn("--clean --clean-filter transport_regression --spp 4", self.arguments())
        self.assertIn("--seed 0", self.arguments())
        self.assertNotIn("--threads", self.arguments())
        own.use_error, own.error, own.seed = True, 0.25, 7
        scene.render.threads_mode, scene.render.threads = "FIXED", 3
        words = self.arguments()
        self.assertIn("--target-error 0.25", words)
        self.assertNotIn("--spp", words)
        self.assertIn("--seed 7", words)
        self.assertIn("--threads 3", words)
        own.use_time, own.time, own.use_fixed_seed, own.use_clean = True, 90, True, False
        words = self.arguments()
        self.assertIn("--time 90.000000s", words)
        self.assertNotIn("--clean", words)
        self.assertIn("-D render.noise_frame=0", words)

    def test_presets_set_what_they_promise(self):
        scene = scenes.smoke_scene()
        own = scene.brume
        own.use_time, own.use_clean = True, False
        bpy.ops.brume.preset(preset="final")
        self.assertTrue(own.use_clean and own.use_error and not own.use_time)
        bpy.ops.brume.preset(preset="preview")
        self.assertTrue(own.use_clean and own.ends_by_samples())
        self.assertEqual(own.samples, presets.PRESETS["preview"][2]["samples"])
        self.render()

    def test_a_target_error_is_reached_and_other_filters_clean(self):
        scene = scenes.smoke_scene(floor=False)
        scene.brume.use_error, scene.brume.error = True, 0.001
        bpy.context.view_layer.brume.layers = "sample_count"
        counts = self.layer(self.render(), "sample_count", "Y")
        self.assertGreater(counts.max(), counts.min(), "samples went where they were needed")
        scene.brume.use_error, scene.brume.filter = False, "gaussian"
        self.render()
        scene.brume.filter = "gausian"
        self.assertIn("gaussian", self.error_of(), "the nearest name")


class Errors(EngineTest):
    def test_a_broken_volume_is_the_programs_message(self):
        scenes.smoke_scene(path=BROKEN)
        error = self.error_of()
        self.assertIn("README.md", error)
        scenes.smoke_scene(path=self.path("absent.vdb"))
        self.assertIn("absent.vdb", self.error_of())

    def test_a_scene_without_a_camera_is_refused(self):
        scene = scenes.smoke_scene()
        scene.camera = None
        self.assertIn("camera", self.error_of().lower())

    def test_stereo_is_refused(self):
        scene = scenes.smoke_scene()
        scene.render.use_multiview = True
        self.assertIn("Stereoscopy", self.error_of())

    def test_a_program_that_is_not_there_or_another_is_named(self):
        scenes.smoke_scene()
        own = bpy.context.preferences.addons["brume_blender"].preferences
        own.program = self.path("nowhere")
        self.assertIn(self.path("nowhere"), self.error_of())
        own.program = sys.executable if os.path.basename(sys.executable).startswith("python") else "/bin/ls"
        self.assertIn("is not brume", self.error_of())
        with open(self.path("old"), "w") as file:
            file.write("#!/bin/sh\necho 'brume 0.0.9 (abc)'\n")
        os.chmod(self.path("old"), 0o755)
        own.program = self.path("old")
        self.assertIn("is brume 0.0.9; this add-on needs", self.error_of())

    def test_a_program_that_dies_is_told(self):
        scenes.smoke_scene()
        with open(self.path("dies"), "w") as file:
            file.write("#!/bin/sh\n[ \"$1\" = --version ] && { echo 'brume 9.0.0 (abc)'; exit 0; }\nkill -9 $$\n")
        os.chmod(self.path("dies"), 0o755)
        bpy.context.preferences.addons["brume_blender"].preferences.program = self.path("dies")
        self.assertIn("killed by signal 9", self.error_of())

    def test_a_missed_target_is_told_and_the_picture_is_kept(self):
        scene = scenes.smoke_scene()
        scene.brume.use_error, scene.brume.error, scene.brume.use_time, scene.brume.time = True, 1e-5, True, 0.5
        engine.forget_what_was_said()
        frame = self.render()
        self.assertGreater(self.layer(frame, "Combined").mean(), 0.1)
        self.assertTrue(any("not reached" in text for text in engine.Said.texts), engine.Said.texts)

    def test_what_is_left_out_is_said_once_in_an_animation(self):
        scene = scenes.smoke_scene(width=16, height=12)
        scene.brume.samples = 1
        light = bpy.data.lights.new("Spot", "SPOT")
        light.shadow_soft_size = 0.5
        scenes.link("Spot", light, (0, 0, 5))
        said = []
        original = engine.BrumeRenderEngine.say

        def say(self, text):
            if text not in engine.Said.texts:
                said.append(text)
            original(self, text)

        engine.BrumeRenderEngine.say = say
        try:
            scene.frame_start, scene.frame_end = 1, 3
            scene.render.filepath = self.path("shot_####")
            bpy.ops.render.render(animation=True)
            once = list(said)
            self.render()
        finally:
            engine.BrumeRenderEngine.say = original
        self.assertTrue(once, "a spot's size has no counterpart")
        self.assertEqual(len(once), len(set(once)))
        self.assertEqual(said, once + once, "another render says it again")
        self.assertEqual(scenes.leftovers(), [])


if __name__ == "__main__":
    scenes.run_tests(sys.modules[__name__])
