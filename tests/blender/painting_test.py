"""Pictures that nodes compute, by F12 and by a viewport without a window: which images they are of, and what becomes of values that
are no numbers. Runs inside Blender."""

import math
import os
import re
import sys
import threading
import time
import types
import unittest
import unittest.mock

import bpy
import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import addon_scene as scenes  # noqa: E402
import brume_blender.translate as package  # noqa: E402
from addon_scene import exr  # noqa: E402
from brume_blender.translate import Bakes, Folder, View, painting, translate, world  # noqa: E402

PATIENCE = 120
SIZE = (16, 8)


def image_of(value, name="image"):
    """A float image of one grey."""
    image = bpy.data.images.new(name, *SIZE, float_buffer=True)
    image.colorspace_settings.name = "Linear"
    paint(image, grey(value))
    return image


def grey(value):
    return np.broadcast_to([value, value, value, 1], (SIZE[1], SIZE[0], 4))


def paint(image, pixels):
    image.pixels.foreach_set(np.ascontiguousarray(pixels, np.float32).ravel())
    image.update()


def between(target, kind, image, node="ShaderNodeInvert"):
    """An image that reaches a socket through a node. @return its texture's node"""
    tree = target.id_data
    texture, middle = tree.nodes.new(kind), tree.nodes.new(node)
    texture.image = image
    tree.links.new(texture.outputs["Color"], middle.inputs["Color"])
    tree.links.new(middle.outputs[0], target)
    return texture


def grouped(target, kind, image):
    """The same, with the texture in a group in a group."""
    for depth in range(2):
        group = bpy.data.node_groups.new(f"Group {depth}", "ShaderNodeTree")
        group.outputs.new("NodeSocketColor", "Color")
        tree, node = target.id_data, target.id_data.nodes.new("ShaderNodeGroup")
        node.node_tree = group
        tree.links.new(node.outputs[0], target)
        target = group.nodes.new("NodeGroupOutput").inputs[0]
    return between(target, kind, image)


class Painted(unittest.TestCase):
    def setUp(self):
        folder = scenes.folder()
        self.addCleanup(folder.cleanup)
        self.path, self.scene = folder.name, scenes.new_scene()
        scenes.add_camera()
        scenes.add_floor()
        self.scene.world = bpy.data.worlds.new("World")
        self.scene.world.use_nodes = True
        self.floor = bpy.data.materials["Floor"].node_tree.nodes["Diffuse BSDF"].inputs["Color"]
        self.sky = self.scene.world.node_tree.nodes["Background"].inputs["Color"]
        for patch in (
            unittest.mock.patch.object(world, "BAKED", (32, 16)),
            unittest.mock.patch.object(package._Translator, "_is_shown", lambda *_: True),
        ):
            patch.start()
            self.addCleanup(patch.stop)

    def depsgraph(self):
        bpy.context.view_layer.update()
        return bpy.context.evaluated_depsgraph_get()

    def pictures(self):
        """Paths of those that are there, parts included."""
        return sorted(os.path.join(self.path, name) for name in os.listdir(self.path) if name.endswith(".exr"))


class Values(Painted):
    def test_what_is_no_number_is_repaired_and_counted(self):
        given = np.array([[0.5, 1, 2], [np.nan, 1, np.inf], [-np.inf, -1, 8], [1e60, 4, 0]])
        stored = np.array([[0.5, 1, 2], [0, 1, 8], [0, 0, 8], [8, 4, 0]])
        path = os.path.join(self.path, "a.exr")
        for is_light, scale, most in ((True, 8, 8), (False, 1, 1)):
            made = painting.Painting((4, 1), lambda first, last: given[first:last], is_light)
            self.assertEqual(made.write(path, lambda: None), (scale, 4))
            np.testing.assert_allclose(scale * exr.read(path).layer("", "RGB")[0], np.minimum(stored, most))

    def test_an_infinite_sun_is_the_brightest_texel_and_said_once(self):
        pixels = grey(0.25).copy()
        pixels[5, 4, :3], pixels[2, 9, 0] = np.inf, np.nan
        pixels[1, 1, :3] = 3
        image = image_of(0)
        paint(image, pixels)
        texture = between(self.sky, "ShaderNodeTexEnvironment", image, "ShaderNodeGamma")
        turn = texture.id_data.nodes.new("ShaderNodeMapping")
        turn.inputs["Rotation"].default_value = (0, 0, math.pi / 3)
        texture.id_data.links.new(texture.id_data.nodes.new("ShaderNodeTexCoord").outputs["Generated"], turn.inputs[0])
        texture.id_data.links.new(turn.outputs[0], texture.inputs["Vector"])
        made = translate(self.depsgraph(), self.scene, self.path)
        notes = [note for note in made.notes if "no finite numbers" in note]
        told = "has 4 values that are no finite numbers: NaN became 0, infinity the largest of the others"
        self.assertEqual(notes, [f"World: the image image {told}"])
        self.assertNotRegex(made.text, r"\b(inf|nan)\b")
        (path,) = self.pictures()
        sky = exr.read(path).layer("", "RGB")
        self.assertTrue(np.isfinite(sky).all())
        # As much light as another texel of that colour, not more by what lies between it and its neighbours.
        peak = float(re.search(r"radiance = \[([^,]*)", made.text)[1])
        excess, texels = peak * sky[..., 1] - 0.25, 32 * 16 / (SIZE[0] * SIZE[1])
        self.assertAlmostEqual(excess.sum() / texels / (2 * 2.75), 1, delta=0.01)

    def test_what_nodes_compute_is_told_whenever_it_is_shown(self):
        view, folder = View(types.SimpleNamespace(), 100.0, Bakes()), Folder(self.path)
        self.addCleanup(view.bakes.close)
        tree = self.sky.id_data
        steep, noise = tree.nodes.new("ShaderNodeVectorMath"), tree.nodes.new("ShaderNodeTexChecker")
        noise.inputs["Color1"].default_value, noise.inputs["Color2"].default_value = (1e30, 1, 1, 1), (1, 1, 1, 1)
        steep.operation = "MULTIPLY"
        tree.links.new(noise.outputs["Color"], steep.inputs[0])
        tree.links.new(noise.outputs["Color"], steep.inputs[1])
        tree.links.new(steep.outputs[0], self.sky)
        image = image_of(np.inf)
        between(self.floor, "ShaderNodeTexImage", image)
        for attempt in range(4):
            view.bakes.begin()
            made = translate(self.depsgraph(), self.scene, folder, view=view)
            view.bakes.settle()
            self.assertNotRegex(made.text, r"\b(inf|nan)\b")
            while view.bakes.busy():
                time.sleep(0.01)
            said = any("the picture that its nodes compute has" in note for note in made.notes)
            self.assertEqual(said, attempt > 0)
            self.assertIn(f"Floor: the image image has {3 * SIZE[0] * SIZE[1]} values that are no finite", "\n".join(made.notes))


class Beside(Painted):
    """A viewport's."""

    def setUp(self):
        super().setUp()
        self.folder, self.bakes = Folder(self.path), Bakes()
        self.gate, self.begun, original = threading.Event(), [], painting.Painting.write

        def gated(own, path, check):
            self.begun.append(path)
            while not self.gate.wait(0.01):
                check()
            return original(own, path, check)

        patch = unittest.mock.patch.object(painting.Painting, "write", gated)
        patch.start()
        self.addCleanup(patch.stop)
        self.addCleanup(self.bakes.close)

    def translated(self):
        """@return what is still being painted"""
        self.bakes.begin()
        translate(self.depsgraph(), self.scene, self.folder, view=View(types.SimpleNamespace(), 100.0, self.bakes))
        return self.bakes.settle()

    def wait(self, condition):
        end = time.monotonic() + PATIENCE
        while not condition():
            self.assertLess(time.monotonic(), end, "waited in vain")
            time.sleep(0.01)

    def shown(self):
        """The mean of what is shown in the end."""
        self.gate.set()
        while self.translated():
            self.wait(lambda: not self.bakes.busy())
        ((path, peak),) = [(value.path, value.peak) for value in self.folder.written.values() if hasattr(value, "moves")]
        return peak * exr.read(path).layer("", "RGB").mean(dtype=float)

    def targets(self):
        return ((self.floor, "ShaderNodeTexImage"), (self.sky, "ShaderNodeTexEnvironment"))

    def test_an_image_that_changes_while_it_is_painted_is_painted_again(self):
        for place in (between, grouped):
            for which in range(2):
                for is_done in (False, True):
                    with self.subTest(place=place.__name__, which=which, is_done=is_done):
                        self.setUp()
                        target, kind = self.targets()[which]
                        image = image_of(0.2)
                        place(target, kind, image)
                        self.assertTrue(self.translated())
                        self.wait(lambda: self.begun)
                        if is_done:
                            self.gate.set()
                            self.wait(lambda: not self.bakes.busy())
                        paint(image, grey(0.7))
                        self.folder.forget_pictures()
                        self.assertTrue(self.translated())
                        self.assertAlmostEqual(self.shown(), 0.3, delta=1e-3)
                        self.doCleanups()

    def test_room_for_others_paints_nothing_again(self):
        between(self.floor, "ShaderNodeTexImage", image_of(0.2))
        self.folder.pictures.MOST = 0
        for value in range(2):
            self.folder.pictures.of(image_of(value, f"other {value}"))
        self.assertAlmostEqual(self.shown(), 0.8, delta=1e-3)
        self.folder.pictures.of(image_of(0, "another"))
        self.assertFalse(self.translated())
        self.assertEqual(len(self.begun), 1)

    def test_another_frame_forgets_sequences_in_groups(self):
        for which in range(2):
            with self.subTest(which=which):
                self.setUp()
                target, kind = self.targets()[which]
                image = image_of(0.2)
                image.filepath_raw, image.file_format = os.path.join(self.path, "frame_0001.hdr"), "HDR"
                image.save()
                image = bpy.data.images.load(image.filepath_raw)
                image.source = "SEQUENCE"
                grouped(target, kind, image)
                # Colours that differ, whether Blender finds the frame or not.
                tree = target.id_data
                mix, ramp = tree.nodes.new("ShaderNodeMixRGB"), tree.nodes.new("ShaderNodeTexNoise")
                tree.links.new(ramp.outputs["Fac"], mix.inputs[0])
                tree.links.new(target.links[0].from_socket, mix.inputs[1])
                tree.links.new(mix.outputs[0], target)
                self.shown()
                self.folder.forget_frame()
                self.assertFalse([value for value in self.folder.written.values() if hasattr(value, "moves")])
                self.doCleanups()

    def test_what_nobody_collects_leaves_no_file(self):
        texture = between(self.floor, "ShaderNodeTexImage", image_of(0.2))
        factor = texture.outputs["Color"].links[0].to_node.inputs["Fac"]
        self.gate.set()
        for value in (0.9, 0.8, 0.7):
            factor.default_value = value
            self.assertTrue(self.translated())
            self.assertLessEqual(len(self.pictures()), 1, "of the value before, at most")
            self.wait(lambda: not self.bakes.busy())
        self.assertEqual(self.pictures(), self.begun[-1:])
        self.shown()
        self.assertEqual(len(self.pictures()), 1)
        self.assertNotIn(".part.", self.pictures()[0])

    def test_a_picture_that_is_done_as_it_is_cancelled_leaves_no_file(self):
        between(self.floor, "ShaderNodeTexImage", image_of(0.2))
        patched = painting.Painting.write

        def until_cancelled(own, path, check):
            made = patched(own, path, check)
            self.wait(lambda: not self.bakes.busy())
            return made

        self.gate.set()
        with unittest.mock.patch.object(painting.Painting, "write", until_cancelled):
            self.translated()
            self.wait(self.pictures)
            self.bakes.close()
        self.assertEqual(self.pictures(), [])


if __name__ == "__main__":
    scenes.run_tests(sys.modules[__name__])
