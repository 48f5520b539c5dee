"""Run by viewport_test.py in a Blender with a window: looks at a scene in Rendered shading, does to it what users do, and writes
what it has seen as JSON.

    blender --python viewport_window.py -- SCENE.blend OUT_FOLDER
"""

import json
import os
import signal
import sys
import threading
import time
import traceback

import addon_utils
import bpy
import numpy as np
from mathutils import Quaternion

sys.path[:0] = [os.path.join(os.environ["BRUME_SOURCE"], "apps", "blender"), os.path.dirname(os.path.abspath(__file__))]
addon_utils.enable("brume_blender", default_set=True)
import viewport_mix  # noqa: E402
from brume_blender import viewport as own  # noqa: E402
from brume_blender.translate import beside, painting  # noqa: E402

SCENE, FOLDER = sys.argv[sys.argv.index("--") + 1 :]
PATIENCE = 120  # seconds for a picture, whatever the machine
seen = {"failed": []}


def views():
    return list(own._viewports.values())


def srgb(linear):
    linear = np.clip(linear, 0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


class Scenario:
    """Steps between which Blender runs: each yields what it waits for, a function that says whether it is there."""

    def __init__(self):
        self.window = bpy.context.window_manager.windows[0]
        self.area = next(area for area in self.window.screen.areas if area.type == "VIEW_3D")
        self.region = next(region for region in self.area.regions if region.type == "WINDOW")
        self.space, self.scene = self.area.spaces[0], bpy.context.scene
        self.space.overlay.show_overlays = self.space.show_gizmo = False
        self.scene.view_settings.view_transform = "Standard"
        self.scene.brume.viewport_samples = 8
        self.scene.camera.data.show_passepartout = False

    def shown(self, stage=None, after=0):
        """The newest picture, if it is of a later look than `after`."""
        found = [view for view in views() if view._shown is not None and view._shown.about["id"] > after]
        return bool(found) and (stage is None or found[0]._shown.about["stage"] == stage)

    def answered(self, whole=True):
        """Waits for a picture of the last look, of its whole size."""

        def is_there():
            for view in views():
                if view._shown is None or view._shown.about["id"] != view._number or (whole and not view._shown.about["full"]):
                    return False
            return bool(views())

        return is_there

    def screenshot(self, name):
        """(height, width, 3) of the region, rows from the bottom."""
        path = os.path.join(FOLDER, name + ".png")
        with bpy.context.temp_override(window=self.window, area=self.area):
            bpy.ops.screen.screenshot(filepath=path)
        image = bpy.data.images.load(path)
        pixels = np.array(image.pixels[:], np.float32).reshape(image.size[1], image.size[0], 4)[..., :3]
        bpy.data.images.remove(image)
        r = self.region
        return pixels[r.y : r.y + r.height, r.x : r.x + r.width]

    def compare(self, name):
        """Holds a screenshot to the picture that came: where it lies, and its colours."""
        view = views()[0]
        drawn, (x0, y0, x1, y1) = self.screenshot(name), view._place
        values = view._shown.values.transpose(1, 2, 0)[::-1].astype(np.float32)
        drawn = drawn[y0:y1, x0:x1]
        if drawn.shape != values.shape:
            seen["failed"].append(f"{name}: a picture of {values.shape} in {drawn.shape}")
            return
        free = np.ones(drawn.shape[:2], bool)
        free[-70:] = False  # headers and texts lie over it
        free[:, :60] = free[:, -110:] = False
        off = float(np.abs(drawn - srgb(values))[free].mean())
        seen[name] = {"size": values.shape[:2], "off": off, "mean": float(values.mean())}

    def steps(self):
        began = time.monotonic()
        self.space.shading.type = "RENDERED"
        self.space.region_3d.view_perspective = "PERSP"
        yield lambda: self.shown()
        seen["first"] = time.monotonic() - began
        yield self.answered()
        self.compare("perspective")
        yield lambda: self.shown("clean") and not bpy.app.timers.is_registered(views()[0]._timer)
        self.compare("clean")
        seen["samples"] = views()[0]._shown.about["samples"]

        yield from viewport_mix.steps(self, seen)

        ids, began = set(), time.monotonic()
        while time.monotonic() < began + 3:
            self.space.region_3d.view_rotation = self.space.region_3d.view_rotation @ Quaternion((0, 1, 0), 0.01)
            yield lambda: True
            ids.update(view._shown.about["id"] for view in views())
        seen["pictures_a_second"] = len(ids) / (time.monotonic() - began)
        yield self.answered()

        before = views()[0]._number
        density = bpy.data.materials["Smoke"].node_tree.nodes["Principled Volume"].inputs["Density"]
        began, density.default_value = time.monotonic(), 12
        yield lambda: self.shown(after=before)
        seen["edit"] = time.monotonic() - began
        files = set(os.listdir(views()[0]._path))
        yield self.answered()
        seen["meshes_written_again"] = len(set(os.listdir(views()[0]._path)) - files)

        yield from self.bakes(density)
        yield from self.paints()

        mesh = bpy.data.objects["Floor"].data
        mesh.vertices[0].co.x *= 0.2
        mesh.update()
        yield lambda: self.shown(after=before + 1)
        yield self.answered()
        seen["meshes"] = [name for name in os.listdir(views()[0]._path) if name.endswith(".ply")]

        for perspective in ("CAMERA", "ORTHO"):
            self.space.region_3d.view_perspective = perspective
            self.area.tag_redraw()
            yield self.later(self.answered())
            self.compare(perspective.lower())
        self.space.region_3d.view_perspective = "PERSP"
        self.space.use_render_border = True
        self.space.render_border_min_x, self.space.render_border_max_x = 0.3, 0.8
        self.space.render_border_min_y, self.space.render_border_max_y = 0.25, 0.75
        self.area.tag_redraw()
        yield self.later(self.answered())
        self.compare("border")
        self.space.use_render_border = False
        self.scene.render.film_transparent = True
        yield self.later(self.answered())
        self.screenshot("transparent")
        alpha = views()[0]._live.pictures()["alpha"].values.astype(np.float32).sum(0)
        seen["alpha"] = [float(alpha.min()), float(alpha.max())]
        self.scene.render.film_transparent = False
        yield self.later(self.answered())

        pid = views()[0]._live.pid
        os.kill(pid, signal.SIGKILL)
        yield lambda: views()[0]._live.ended()
        seen["killed"] = views()[0]._live.problem()
        density.default_value = 3
        yield self.later(self.answered(whole=False))
        seen["started_again"] = views()[0]._live.pid != pid

        volume = bpy.data.volumes["Smoke"]
        path, volume.filepath = volume.filepath, os.path.join(FOLDER, "missing.vdb")
        yield lambda: views()[0]._problem is not None
        seen["problem"] = views()[0]._problem
        yield self.later(lambda: True)
        drawn = self.screenshot("problem")
        seen["problem_pixels"] = int(np.all(np.abs(drawn - srgb(own.PROBLEM_COLOUR[:3])) < 0.1, -1).sum())
        volume.filepath = path
        yield self.later(self.answered(whole=False))
        seen["mended"] = views()[0]._problem is None

        with bpy.context.temp_override(window=self.window, area=self.area, region=self.region):
            bpy.ops.screen.area_split(direction="VERTICAL", factor=0.5)
        for area in self.window.screen.areas:
            if area.type == "VIEW_3D":
                area.spaces[0].shading.type = "RENDERED"
        yield lambda: len(views()) == 2 and self.answered(whole=False)()
        seen["viewports"] = len({view._live.pid for view in views()})
        self.screenshot("two")
        self.pids, paths = [view._live.pid for view in views()], [view._path for view in views()]
        for area in self.window.screen.areas:
            if area.type == "VIEW_3D":
                area.spaces[0].shading.type = "SOLID"
        yield lambda: not views()
        seen["left"] = [path for path in [*paths, *(f"/proc/{pid}" for pid in self.pids)] if os.path.exists(path)]
        self.space.shading.type = "RENDERED"
        yield self.later(self.answered(whole=False))
        seen["pid"] = views()[0]._live.pid

    def bakes(self, density):
        """A shader that has to be baked, by a bake that takes as long as this lets it."""
        view, original, began, cancelled, gate = views()[0], beside.bake, [], [], threading.Event()

        def slow(shader, source, folder, most_voxels, notes, check):
            began.append(threading.current_thread() is threading.main_thread())
            while not gate.is_set():
                try:
                    check()
                except beside.Cancelled:
                    cancelled.append(len(began))
                    raise
                time.sleep(0.01)
            return original(shader, source, folder, most_voxels, notes, check)

        beside.bake = slow
        tree, revision, text = density.id_data, view._revision, view._text
        noise, times = tree.nodes.new("ShaderNodeTexNoise"), tree.nodes.new("ShaderNodeMath")
        times.operation, times.inputs[1].default_value = "MULTIPLY", 30
        tree.links.new(noise.outputs["Fac"], times.inputs[0])
        tree.links.new(times.outputs[0], density)
        yield lambda: view._baking and began
        seen["baking"] = view._state()
        for _ in range(2):  # Blender draws, and the picture follows, of the scene as it was
            before = view._number
            self.space.region_3d.view_rotation = self.space.region_3d.view_rotation @ Quaternion((0, 1, 0), 0.1)
            yield lambda: self.shown(after=before)
        seen["stays_while_baking"] = (view._revision, view._text) == (revision, text)
        noise.inputs["Scale"].default_value = 3
        yield lambda: len(began) == 2
        seen["cancelled"], seen["bakes_in_main_thread"] = list(cancelled), any(began)
        gate.set()
        yield lambda: not view._baking
        yield self.later(self.answered())
        seen["baked"] = view._revision > revision and "baked_0" in view._text
        self.screenshot("baked")
        times.inputs[1].default_value = 20
        yield lambda: len(began) == 3 and not view._baking
        times.inputs[1].default_value = 30  # known
        yield self.later(lambda: "baked_0" in view._text and not view._baking)
        seen["bakes"] = len(began)
        beside.bake = original
        tree.links.remove(density.links[0])
        yield self.later(self.answered())

    def paints(self):
        """A floor whose colour nodes compute, by a painting that takes as long as this lets it."""
        view, original, began, gate = views()[0], painting.Painting.write, [], threading.Event()

        def slow(own, path, check):
            began.append(threading.current_thread() is threading.main_thread())
            while not gate.is_set():
                check()
                time.sleep(0.01)
            return original(own, path, check)

        painting.Painting.write = slow
        tree, text = bpy.data.materials["Floor"].node_tree, view._text
        colour = tree.nodes["Diffuse BSDF"].inputs["Color"]
        tree.links.new(tree.nodes.new("ShaderNodeTexNoise").outputs["Color"], colour)
        yield lambda: view._baking and began
        seen["painting"] = view._state()
        before = view._number
        self.space.region_3d.view_rotation = self.space.region_3d.view_rotation @ Quaternion((0, 1, 0), 0.1)
        yield lambda: self.shown(after=before)
        seen["stays_while_painting"] = view._text == text
        gate.set()
        yield lambda: not view._baking
        yield self.later(self.answered())
        seen["painted"] = "albedo_texture" in view._text
        self.screenshot("painted")
        self.scene.frame_set(2)
        yield self.later(self.answered())
        seen["paintings"], seen["paints_in_main_thread"] = len(began), any(began)
        painting.Painting.write = original
        tree.links.remove(colour.links[0])
        yield self.later(self.answered())

    def later(self, condition):
        """Not before Blender has drawn."""
        drawn = time.monotonic() + 0.5
        return lambda: time.monotonic() > drawn and condition()


def main():
    bpy.ops.wm.open_mainfile(filepath=SCENE, load_ui=False)
    scenario = Scenario()
    steps = scenario.steps()
    waits = [lambda: True, time.monotonic()]

    def finish():
        with open(os.path.join(FOLDER, "seen.json"), "w") as file:
            json.dump(seen, file)
        return None  # the test ends this Blender

    def step():
        try:
            if not waits[0]():
                if time.monotonic() > waits[1] + PATIENCE:
                    raise TimeoutError(f"waited in vain after {list(seen)[-1]}; {[view._problem for view in views()]}")
                return 0.01
            waits[:] = next(steps), time.monotonic()
            return 0.01
        except StopIteration:
            return finish()
        except Exception:  # told by the test
            seen["failed"].append(traceback.format_exc())
            return finish()

    bpy.app.timers.register(step, first_interval=1)


main()
