"""Tests of a scene that a Builder makes, rendered by either engine. Runs inside Blender."""

import os
import unittest

import addon_utils
import bpy

import addon_scene as scenes
from builder import Builder


class BuiltTest(unittest.TestCase):
    def build(self, width, height, sky):
        """Begins the scene: a camera and a world of one colour. @return its Builder"""
        folder = scenes.folder()
        self.addCleanup(folder.cleanup)
        self.folder = folder.name
        self.b = Builder(os.path.join(scenes.SOURCE, "data"), width, height)
        addon_utils.enable("brume_blender", default_set=True)
        self.b.camera((0, -9, 2), (0, 0, 0.6), 40)
        self.b.world(sky)
        self.layer = bpy.context.view_layer
        return self.b

    def rendered(self, engine, samples=16, clean=False):
        """@return function of a pass's name and components: its array"""
        scene = self.b.scene
        self.b.plain(samples)
        scene.brume.samples, scene.brume.use_clean = samples, clean
        scene.render.engine = engine
        frame = scenes.render(os.path.join(self.folder, engine + ".exr"), scene)
        return lambda name, components="RGB": frame.layer(f"{self.layer.name}.{name}", components)
