"""Cryptomatte: what Blender's own node makes of brume's passes and files; holdouts."""

import os
import subprocess
import sys
import unittest

import bpy
import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import addon_scene as scenes  # noqa: E402
from brume_blender import passes  # noqa: E402
from addon_scene import exr  # noqa: E402


def matte_of(frame, prefix, name, levels):
    """A thing's share of each pixel by the ranks, with a hash of its own."""
    wanted = np.array([passes.murmur_hash(name.encode())], np.uint32)
    exponent = wanted >> 23 & 255
    wanted[(exponent == 0) | (exponent == 255)] ^= 1 << 23
    share = np.zeros((frame.height, frame.width), np.float32)
    for i in range((levels + 1) // 2):
        for number, coverage in (("r", "g"), ("b", "a")):
            ids = np.ascontiguousarray(channel(frame, f"{prefix}{i:02}.{number}")).view(np.uint32)
            share += np.where(ids == wanted[0], channel(frame, f"{prefix}{i:02}.{coverage}"), 0)
    return share


def channel(frame, name):
    """Whether Blender wrote its letter large or small."""
    return next(values for key, values in frame.channels.items() if key.lower() == name.lower())


class MatteTest(unittest.TestCase):
    def setUp(self):
        self._folder = scenes.folder()
        self.addCleanup(self._folder.cleanup)

    def path(self, name):
        return os.path.join(self._folder.name, name)

    def scene(self, levels=4):
        scene = scenes.smoke_scene(width=48, height=36)
        layer = bpy.context.view_layer
        layer.use_pass_cryptomatte_object = layer.use_pass_cryptomatte_material = True
        layer.pass_cryptomatte_depth = levels
        scene.render.film_transparent = True
        return scene

    def by_node(self, source, layer, names, image=None):
        """The mattes that Blender's Cryptomatte node gives when the scene is rendered."""
        scene = bpy.context.scene
        scene.use_nodes = True
        nodes, links = scene.node_tree.nodes, scene.node_tree.links
        nodes.clear()
        links.new(nodes.new("CompositorNodeRLayers").outputs["Image"], nodes.new("CompositorNodeComposite").inputs["Image"])
        out = nodes.new("CompositorNodeOutputFile")
        out.base_path = self._folder.name
        out.format.file_format, out.format.color_depth, out.format.exr_codec = "OPEN_EXR", "32", "ZIP"
        out.file_slots.clear()
        for i, name in enumerate(names):
            node = nodes.new("CompositorNodeCryptomatteV2")
            node.source = source
            if source == "IMAGE":
                node.image = image
            else:
                node.scene = scene
            node.layer_name = layer
            node.matte_id = name
            self.assertEqual(node.matte_id, name)
            out.file_slots.new(f"matte{i}_")
            links.new(node.outputs["Matte"], out.inputs[i])
        frame = scenes.render(self.path("again.exr"))
        scene.use_nodes = False
        mattes = []
        for i in range(len(names)):
            file = exr.read(self.path(f"matte{i}_{scene.frame_current:04}.exr"))
            mattes.append(next(file.channels[c] for c in ("R", "V", "Y") if c in file.channels))
        return frame, mattes

    def test_passes_are_named_and_described_as_cycles_ones(self):
        self.scene(levels=4)
        frame = scenes.render(self.path("frame.exr"))
        for prefix in ("ViewLayer.CryptoObject", "ViewLayer.CryptoMaterial"):
            self.assertEqual(sum(key.startswith(prefix) for key in frame.channels), 8)
            key = f"{passes.murmur_hash(prefix.encode()):08x}"[:7]
            self.assertEqual(frame.header[f"cryptomatte/{key}/name"], prefix)
            self.assertEqual(frame.header[f"cryptomatte/{key}/hash"], "MurmurHash3_32")
            self.assertIn('"Smoke"', frame.header[f"cryptomatte/{key}/manifest"])
        self.assertIn('"Floor"', frame.header[f"cryptomatte/{passes.murmur_hash(b'ViewLayer.CryptoObject'):08x}"[:19] + "/manifest"])
        smoke, floor = (matte_of(frame, "ViewLayer.CryptoObject", name, 4) for name in ("Smoke", "Floor"))
        self.assertGreater(smoke.max(), 0.5)
        self.assertGreater(floor.max(), 0.99)
        np.testing.assert_allclose(smoke + floor, frame.layer("ViewLayer.Combined", "A")[..., 0], atol=1e-6)

    def test_blenders_node_takes_them_from_the_render(self):
        self.scene()
        scenes.render(self.path("first.exr"))  # which tells the node what layers there are
        for layer in ("ViewLayer.CryptoObject", "ViewLayer.CryptoMaterial"):
            frame, mattes = self.by_node("RENDER", layer, ["Smoke", "Floor"])
            for name, matte in zip(("Smoke", "Floor"), mattes):
                np.testing.assert_allclose(matte, matte_of(frame, layer, name, 4), atol=1e-6, err_msg=f"{layer} {name}")
                self.assertGreater(matte.max(), 0.5)

    def test_blenders_node_takes_them_from_brumes_file(self):
        text = f"""[camera]\nposition = [0, -7, 2]\nlook_at = [0, 0, 1]\nfov = 34
[film]\nwidth = 48\nheight = 36\n[environment]\nradiance = 0.5
[[volumes]]\nfile = {scenes.SMOKE!r}\nsigma_t = 6\nname = "Rök"
[[surfaces]]\nfile = {os.path.join(scenes.SOURCE, "data", "meshes", "floor.obj")!r}\nmaterial_name = "grass"\n"""
        with open(self.path("scene.toml"), "w", encoding="utf-8") as file:
            file.write(text)
        brume = [os.environ["BRUME_PROGRAM"]]
        subprocess.run(
            [*brume, "render", self.path("scene.toml"), "--layers", "cryptomatte", "--spp", "1", "-q", "-o", self.path("own.exr")], check=True
        )
        for name in ("Rök", "floor"):
            subprocess.run([*brume, "matte", self.path("own.exr"), name, "-o", self.path(f"{name}.exr")], check=True)
        scenes.smoke_scene(width=48, height=36)
        image = bpy.data.images.load(self.path("own.exr"))
        _, mattes = self.by_node("IMAGE", "CryptoObject", ["Rök", "floor"], image)
        for name, matte in zip(("Rök", "floor"), mattes):
            np.testing.assert_allclose(matte, exr.read(self.path(f"{name}.exr")).channels["A"], atol=1e-6, err_msg=name)
            self.assertGreater(matte.max(), 0.5)

    def test_a_volume_that_is_a_holdout_leaves_a_hole(self):
        scene = scenes.smoke_scene(width=48, height=36)
        scene.render.film_transparent = True
        smoke = bpy.data.objects["Smoke"]
        plain = scenes.render(self.path("plain.exr")).layer("ViewLayer.Combined", "A")
        smoke.is_holdout = True
        held = scenes.render(self.path("held.exr")).layer("ViewLayer.Combined", "A")
        self.assertGreater(plain.min() + 0.3, held.min())
        self.assertLess((held - plain).max(), 0.05)
        self.assertGreater((plain - held).max(), 0.3)

    def test_objects_that_share_their_volume_have_mattes_of_their_own(self):
        self.scene(levels=4)
        other = scenes.link("Other", bpy.data.objects["Smoke"].data, (1, 0, 0))
        frame = scenes.render(self.path("two.exr"))
        smoke, second = (matte_of(frame, "ViewLayer.CryptoObject", name, 4) for name in ("Smoke", "Other"))
        self.assertGreater(min(smoke.max(), second.max()), 0.5)
        both = matte_of(frame, "ViewLayer.CryptoMaterial", "Smoke", 4)
        np.testing.assert_allclose(smoke + second, both, atol=1e-6)
        other.is_holdout = True
        frame = scenes.render(self.path("held.exr"))
        self.assertEqual(matte_of(frame, "ViewLayer.CryptoObject", "Other", 4).max(), 0)
        np.testing.assert_allclose(matte_of(frame, "ViewLayer.CryptoObject", "Smoke", 4), smoke, atol=0.02)


if __name__ == "__main__":
    scenes.run_tests(sys.modules[__name__])
