"""Shader nodes as node_values computes them, against Cycles: each node's output goes into a pass of a plane, one sample for a
pixel, with the points that it was computed at. Runs inside Blender."""

import os
import sys
import unittest

import bpy
import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import addon_scene as scenes  # noqa: E402
from brume_blender.translate import procedural  # noqa: E402
from brume_blender.translate.node_values import Values  # noqa: E402
from brume_blender.translate.nodes import Plug  # noqa: E402
from builder import Builder, Shader  # noqa: E402

TOLERANCE = 2e-4  # floats of Cycles, times the textures' scales
DIMENSIONS = ("1D", "2D", "3D", "4D")


def _settings():
    """(node, properties, inputs, output, share of points that may differ: where a texture jumps)."""
    for d in DIMENSIONS:
        yield "TexNoise", {"noise_dimensions": d}, {"Scale": 3, "Detail": 2.5, "Roughness": 0.6, "Distortion": 0.7}, "Fac", 0
        yield "TexNoise", {"noise_dimensions": d}, {"Scale": 2, "Detail": 4}, "Color", 0
        yield "TexWhiteNoise", {"noise_dimensions": d}, {}, "Value", 0
        yield "TexWhiteNoise", {"noise_dimensions": d}, {}, "Color", 0
        for feature in ("F1", "F2", "SMOOTH_F1", "DISTANCE_TO_EDGE", "N_SPHERE_RADIUS"):
            output = "Radius" if feature == "N_SPHERE_RADIUS" else "Distance"
            yield "TexVoronoi", {"voronoi_dimensions": d, "feature": feature}, {"Scale": 2, "Randomness": 0.8}, output, 0
            if feature in ("F1", "SMOOTH_F1"):
                yield "TexVoronoi", {"voronoi_dimensions": d, "feature": feature}, {"Scale": 2}, "Color", 0.002
        for kind in ("FBM", "MULTIFRACTAL", "HYBRID_MULTIFRACTAL", "RIDGED_MULTIFRACTAL", "HETERO_TERRAIN"):
            yield "TexMusgrave", {"musgrave_dimensions": d, "musgrave_type": kind}, {"Scale": 1.5, "Detail": 3.3, "Dimension": 1.2, "Lacunarity": 2.1}, "Fac", 0
    for metric in ("MANHATTAN", "CHEBYCHEV", "MINKOWSKI"):
        yield "TexVoronoi", {"distance": metric}, {"Scale": 2, **({"Exponent": 0.7} if metric == "MINKOWSKI" else {})}, "Distance", 0
    yield "TexVoronoi", {}, {"Scale": 2}, "Position", 0.002
    for kind, directions in (("BANDS", ("X", "DIAGONAL")), ("RINGS", ("Y", "SPHERICAL"))):
        for direction, profile in zip(directions, ("SIN", "TRI")):
            properties = {"wave_type": kind, "wave_profile": profile, kind.lower() + "_direction": direction}
            yield "TexWave", properties, {"Scale": 0.7, "Distortion": 1.5, "Detail": 2.3, "Phase Offset": 0.4}, "Fac", 0
    for kind in ("LINEAR", "QUADRATIC", "EASING", "DIAGONAL", "SPHERICAL", "QUADRATIC_SPHERE", "RADIAL"):
        yield "TexGradient", {"gradient_type": kind}, {}, "Fac", 0
    for depth in range(11):
        yield "TexMagic", {"turbulence_depth": depth}, {"Scale": 0.6, "Distortion": 1.3}, "Color", 0
    yield "TexChecker", {}, {"Scale": 2.3}, "Color", 0.002


class Nodes(unittest.TestCase):
    def test_textures_are_cycles(self):
        """Every texture and setting, at 48 x 36 points of a plane that leans."""
        b = Builder(os.path.join(scenes.SOURCE, "data"), 48, 36)
        b.plain(1)
        camera = b.camera((1, -3, 2), (0.2, 0.1, 0.3))
        camera.data.type, camera.data.ortho_scale = "ORTHO", 3
        shader = Shader("Table")
        position = shader.node("NewGeometry").outputs["Position"]
        w = shader.node("SeparateXYZ", _0=position).outputs["Y"]
        plane = b.mesh("plane", "Table", shader.surface(shader.node("Emission")), size=20, location=(0.2, 0.1, 0.3))
        plane.rotation_euler = (0.7, 0.3, 0.5)
        layer = b.scene.view_layers[0]
        layer.use_pass_position = True
        rows = [("position", position, 0)]
        for number, (kind, properties, inputs, output, jumps) in enumerate(_settings()):
            node = shader.node(kind)
            for key, value in properties.items():
                setattr(node, key, value)
            for key, value in inputs.items():
                shader.put(node.inputs[key], value)
            for key, value in (("Vector", position), ("W", w)):
                if key in node.inputs and node.inputs[key].enabled:
                    shader.put(node.inputs[key], value)
            rows.append((f"{number} {kind} {output} {properties}", node.outputs[output], jumps))
        for number, (_, socket, _) in enumerate(rows):
            layer.aovs.add().name = f"aov{number}"
            output = shader.node("OutputAOV")
            output.name = f"aov{number}"
            shader.put(output.inputs["Color"], socket)
        folder = scenes.folder()
        self.addCleanup(folder.cleanup)
        frame = scenes.exr.read(self._rendered(b, os.path.join(folder.name, "table.exr")))
        points = frame.layer("ViewLayer.aov0", "RGB").reshape(-1, 3).astype(float)
        self.assertGreater(np.ptp(points, axis=0).min(), 1)
        values = Values(lambda plug: points if plug.node.type == "NEW_GEOMETRY" else None)
        wrong = []
        for number, (name, socket, jumps) in enumerate(rows):
            theirs = frame.layer(f"ViewLayer.aov{number}", "RGB").reshape(-1, 3)
            ours = values.colour(Plug(socket))
            off = np.abs(ours - theirs).max(-1) > TOLERANCE * np.maximum(1, np.abs(theirs).max(-1))
            if off.mean() > jumps:
                wrong.append(f"{name}: {100 * off.mean():.1f} % differ, by up to {np.abs(ours - theirs).max():.4g}")
        self.assertEqual(wrong, [], "\n" + "\n".join(wrong))
        print(f"{len(rows)} tables of {len(points)} points")

    def test_the_hash_of_blender_5_is_spread_evenly(self):
        for d in (2, 3, 4):
            cells = np.stack(np.meshgrid(*[np.arange(-4, 4)] * d, indexing="ij"), -1).reshape(-1, d).astype(float)
            for size in {d, 3} - ({3} if d == 2 else set()):
                values = procedural.pcg_hashed(cells, size)
                self.assertEqual(values.shape, (len(cells), size))
                self.assertTrue(values.min() >= 0 and values.max() <= 1)
                self.assertLess(np.abs(values.mean(0) - 0.5).max(), 4 / np.sqrt(12 * len(cells)))

    def _rendered(self, b, path):
        b.render(path, 1)
        return path


if __name__ == "__main__":
    scenes.run_tests(sys.modules[__name__])
