"""Scenes rendered by both engines: the mean of brume's F12 against that of Cycles."""

import os
import time
import unittest

import addon_scene as scenes
import addon_utils
import bpy
import numpy as np
from brume_blender.translate import translate
from builder import Builder

WITHIN = 0.01


class Comparison(unittest.TestCase):
    """Each kind is a function that puts things into a Builder's empty scene, in front of a camera and under a sky."""

    cycles_samples, samples = 24, 96

    def setUp(self):
        folder = scenes.folder()
        self.addCleanup(folder.cleanup)
        self.folder = folder.name

    def built(self, kind):
        b = Builder(os.path.join(scenes.SOURCE, "data"), 48, 36)
        addon_utils.enable("brume_blender", default_set=True)
        b.folder = self.folder
        b.camera((0, -6.5, 1), (0, 0, 0.3), 40)
        b.world([0.3, 0.4, 0.6])
        kind(b)
        b.plain(self.cycles_samples)
        b.scene.brume.samples, b.scene.brume.use_clean, b.scene.brume.indirect_limit = self.samples, False, 0
        b.scene.brume.bake_millions = 6
        return b

    def translated(self, b):
        return translate(bpy.context.evaluated_depsgraph_get(), b.scene, self.folder, bakes=self.folder)

    def compare(self, kind, within=WITHIN):
        """Prints both means and holds brume's to Cycles'."""
        began = time.process_time()
        b, means = self.built(kind), {}
        for engine in ("CYCLES", "BRUME"):
            b.scene.render.engine = engine
            frame = scenes.render(os.path.join(self.folder, engine + ".exr"), b.scene)
            means[engine] = frame.layer(f"{bpy.context.view_layer.name}.Combined", "RGB").mean((0, 1), dtype=float)
        ratio = means["BRUME"] / means["CYCLES"]
        print(f"KIND {kind.__name__}: {np.round(ratio, 4)} of {np.round(means['CYCLES'], 4)}, {time.process_time() - began:.1f} s")
        self.assertLess(np.abs(ratio - 1).max(), within, kind.__name__)
