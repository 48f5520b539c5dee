"""Light groups of a view layer: their passes are Cycles', add up to the picture, and stay what they are when cleaned. Runs
inside Blender."""

import os
import sys

import bpy
import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import addon_scene as scenes  # noqa: E402
from builder import Shader, diffuse  # noqa: E402
from built import BuiltTest  # noqa: E402

from brume_blender import light_mix  # noqa: E402

WIDTH, HEIGHT = 48, 36


class LightGroups(BuiltTest):
    def setUp(self):
        b = self.build(WIDTH, HEIGHT, [0.1, 0.15, 0.3])
        b.floor(diffuse("Floor", (0.5, 0.5, 0.5)), 8)
        fog, glow = Shader("Fog"), Shader("Glow")
        b.mesh("cube", "Fog", fog.volume(fog.node("VolumeScatter", Color=(1, 1, 1), Density=0.7)), size=2, location=(0, 0, 1.05))
        glow.surface(glow.node("Emission", Color=(1, 0.5, 0.2), Strength=6))
        lamp = b.mesh("ico_sphere", "Lamp", glow.material, subdivisions=3, radius=0.4, location=(2, 0, 1.5))
        sun = b.light("SUN", "Sun", (4, -3, 6), (0, 0, 0), energy=2)
        sun.lightgroup, lamp.lightgroup = "key light", "rest"
        b.scene.world.lightgroup = "sky"
        for name in ("key light", "rest", "sky"):
            self.layer.lightgroups.add(name=name)

    def test_are_those_of_cycles(self):
        theirs, ours = self.rendered("CYCLES", 256), self.rendered("BRUME", 256)
        for name in ("Combined", "Combined_key light", "Combined_rest", "Combined_sky"):
            a, b = (of(name).mean((0, 1)) for of in (ours, theirs))
            print(name, a, b)
            np.testing.assert_allclose(a, b, rtol=0.005)

    def test_add_up_to_the_picture_raw_and_clean(self):
        for clean in (False, True):
            of = self.rendered("BRUME", 4, clean)
            total = sum(of("Combined_" + name).astype(float) for name in ("key light", "rest", "sky"))
            np.testing.assert_allclose(total, of("Combined"), rtol=1e-6, atol=1e-7)

    def test_hold_only_what_their_view_layer_knows(self):
        self.layer.active_lightgroup_index = [group.name for group in self.layer.lightgroups].index("rest")
        bpy.ops.scene.view_layer_remove_lightgroup()
        self.layer.lightgroups.add(name="empty")
        of = self.rendered("BRUME", 4)
        self.assertIsNone(of("Combined_rest"))
        np.testing.assert_array_equal(of("Combined_empty"), 0)
        left = of("Combined").mean() - of("Combined_key light").mean() - of("Combined_sky").mean()
        self.assertGreater(left, 0.01)

    def test_scale_with_the_exposure_of_the_film(self):
        before = self.rendered("BRUME", 2)("Combined_sky")
        self.b.scene.cycles.film_exposure = 3
        np.testing.assert_allclose(self.rendered("BRUME", 2)("Combined_sky"), 3 * before, rtol=1e-5)

    def test_are_mixed_in_the_viewport_alone(self):
        before = self.rendered("BRUME", 2)("Combined")
        light_mix.sync(self.layer)
        light_mix.sync(self.layer)
        self.assertEqual([entry.name for entry in self.layer.brume.mix], ["key light", "rest", "sky", ""])
        self.assertEqual(light_mix.mix_of(self.layer, ["key_light", "_rest", "sky", "rest"]), {})
        for group, gain in (("key light", 0), ("rest", 2), ("", 3)):
            light_mix.entry_of(self.layer, group).gain = gain
        light_mix.entry_of(self.layer, "rest").colour = (1, 0.5, 0)
        wanted = {"key_light": [0, 0, 0], "_rest": [2, 1, 0]}
        self.assertEqual(light_mix.mix_of(self.layer, ["key_light", "_rest", "sky"]), wanted)
        self.assertEqual(light_mix.mix_of(self.layer, ["rest"]), {"rest": [3, 3, 3]}, "of what has no group")
        np.testing.assert_array_equal(self.rendered("BRUME", 2)("Combined"), before)
        bpy.ops.brume.reset_light_mix()
        self.assertEqual(light_mix.mix_of(self.layer, ["key_light", "_rest", "rest"]), {})

    def test_of_objects_that_share_a_volume_stay_apart(self):
        """One of two that stand elsewhere is of a group: the other's fire is not in it."""
        first = scenes.add_smoke(scenes.SMOKE, scenes.SMOKE_GRID)
        shader = first.active_material.node_tree.nodes["Principled Volume"]
        shader.inputs["Emission Strength"].default_value = 2
        second = first.copy()
        second.location.x -= 3
        bpy.context.scene.collection.objects.link(second)
        first.lightgroup = "rest"
        one = self.rendered("BRUME", 8)("Combined_rest").mean()
        second.lightgroup = "rest"
        self.assertGreater(self.rendered("BRUME", 8)("Combined_rest").mean(), 1.1 * one)


if __name__ == "__main__":
    scenes.run_tests(sys.modules[__name__])
