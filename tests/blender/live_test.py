"""The viewport without a window: the WebSocket and the program behind it, what a view is in brume's terms, what of a scene is
translated again. Runs inside Blender."""

import json
import os
import sys
import threading
import time
import types
import unittest
import unittest.mock

import bpy
import numpy as np
from mathutils import Matrix

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import addon_scene as scenes  # noqa: E402
import brume_blender.translate as package  # noqa: E402
from brume_blender import live, region  # noqa: E402
from brume_blender.translate import Bakes, Folder, View, translate  # noqa: E402
from brume_blender.translate.camera import camera_table  # noqa: E402
from brume_blender.translate.notes import Notes  # noqa: E402

PATIENCE = 120
CAMERA = ["camera.position=[0,-7,1.5]", "camera.look_at=[0,0,1.5]", "camera.fov=40"]


def wait_until(condition, what):
    end = time.monotonic() + PATIENCE
    while not condition():
        if time.monotonic() > end:
            raise AssertionError(f"waited in vain for {what}")
        time.sleep(0.01)


class FakeWeb(unittest.TestCase):
    """Frames as servers may send them: in pieces, with pings between, long ones."""

    def test_messages_are_put_together(self):
        sent, answered = [], []
        server = live.socket.create_server(("127.0.0.1", 0))
        self.addCleanup(server.close)

        def serve():
            end, _ = server.accept()
            sent.append(end.recv(4096).decode())
            end.sendall(b"HTTP/1.1 101 Switching Protocols\r\n\r\n")
            end.sendall(b"\x01\x03abc" + b"\x89\x02hi" + b"\x80\x03def")  # text in two pieces, a ping between them
            end.sendall(b"\x82\x7f" + (70000).to_bytes(8, "big") + bytes(70000))
            end.sendall(b"\x82\x7e" + (300).to_bytes(2, "big") + b"x" * 300)
            answered.append(end.recv(4096))
            end.sendall(b"\x88\x00")
            end.close()

        thread = threading.Thread(target=serve)
        thread.start()
        web = live.WebSocket(f"http://127.0.0.1:{server.getsockname()[1]}/secret/")
        self.assertEqual(web.receive(), "abcdef")
        self.assertEqual(len(web.receive()), 70000)
        self.assertEqual(web.receive(), b"x" * 300)
        with self.assertRaises(live.Gone):
            web.receive()
        web.close()
        thread.join()
        self.assertTrue(sent[0].startswith("GET /secret/live HTTP/1.1\r\nHost: 127.0.0.1:"))
        self.assertEqual(answered[0], b"\x8a\x82\0\0\0\0hi", "a masked pong")

    def test_what_is_no_websocket_is_gone(self):
        server = live.socket.create_server(("127.0.0.1", 0))
        self.addCleanup(server.close)

        def serve():
            end, _ = server.accept()
            end.sendall(b"HTTP/1.1 404 Not Found\r\n\r\n")
            end.close()

        thread = threading.Thread(target=serve)
        thread.start()
        with self.assertRaisesRegex(live.Gone, "404"):
            live.WebSocket(f"http://127.0.0.1:{server.getsockname()[1]}/")
        thread.join()


class Viewing(unittest.TestCase):
    def setUp(self):
        folder = scenes.folder()
        self.addCleanup(folder.cleanup)
        self.path = folder.name
        self.scene = scenes.smoke_scene()
        self.folder = Folder(self.path)
        bakes = Bakes()
        self.addCleanup(bakes.close)
        self.view = View(types.SimpleNamespace(), 100.0, bakes)
        bpy.context.view_layer.update()

    def translated(self):
        """As a viewport that shows everything."""
        with unittest.mock.patch.object(package._Translator, "_is_shown", lambda *_: True):
            return translate(bpy.context.evaluated_depsgraph_get(), self.scene, self.folder, view=self.view)

    def test_the_program_answers_ends_and_is_said_to_have(self):
        path = os.path.join(self.path, "scene.toml")
        with open(path, "w") as file:
            file.write(self.translated().text)
        looks = live.Live(os.environ["BRUME_PROGRAM"], path)
        self.addCleanup(looks.close)

        def look(revision=1, **more):
            return looks.look(**{"set": CAMERA, "size": [64, 48], "layers": ["picture"], "samples": 8, "revision": revision, **more})

        number = look()
        wait_until(lambda: looks.pictures().get("picture"), "a picture")
        wait_until(looks.rests, "rest")
        picture = looks.pictures()["picture"]
        self.assertEqual((picture.about["id"], picture.values.shape, picture.about["samples"]), (number, (3, 48, 64), 8))
        bright = picture.values.astype(float).mean()
        bpy.data.worlds[0].node_tree.nodes["Background"].inputs["Strength"].default_value = 0.1
        bpy.context.view_layer.update()
        with open(path, "w") as file:
            file.write(self.translated().text)
        number = look(2)
        wait_until(lambda: looks.pictures()["picture"].about["id"] == number, "a picture of the changed scene")
        self.assertLess(looks.pictures()["picture"].values.astype(float).mean(), 0.8 * bright)
        look(2, set=[*CAMERA, "camera.fovv=3"])
        wait_until(looks.problem, "a problem")
        self.assertIn("fovv", looks.problem())
        self.assertTrue(looks.rests())
        number = look(2)
        self.assertIsNone(looks.problem())
        wait_until(lambda: looks.rests() and looks.pictures()["picture"].about["id"] == number, "a picture after the problem")
        os.kill(looks.pid, 9)
        wait_until(looks.ended, "the end")
        self.assertIn("signal 9", looks.problem())

    def test_a_scene_that_cannot_be_read_is_said(self):
        path = os.path.join(self.path, "scene.toml")
        with open(path, "w") as file:
            file.write("[camera]\nposition = 3\n")
        looks = live.Live(os.environ["BRUME_PROGRAM"], path)
        self.addCleanup(looks.close)
        wait_until(looks.ended, "the end")
        self.assertIn("position", looks.problem())

    def test_what_stays_as_it_was_is_not_written_again(self):
        first = self.translated()
        self.assertNotIn("motion", " ".join(first.notes).lower())
        meshes = [path for path in first.files if path.endswith(".ply")]
        self.assertEqual(len(meshes), 1)
        written = os.stat(meshes[0]).st_mtime_ns
        self.assertEqual(self.translated().text, first.text)
        bpy.data.materials["Smoke"].node_tree.nodes["Principled Volume"].inputs["Density"].default_value = 9
        bpy.context.view_layer.update()
        second = self.translated().text
        self.assertNotEqual(second, first.text)
        self.assertEqual(os.stat(meshes[0]).st_mtime_ns, written)
        floor = bpy.data.objects["Floor"]
        floor.data.vertices[0].co.x *= 0.5
        floor.data.update()
        bpy.context.view_layer.update()
        self.folder.forget_geometry({"Floor"})
        third = self.translated()
        self.assertNotEqual(third.text, second, "another mesh has another name")
        self.folder.remove_unused(third.text)
        self.assertFalse(os.path.exists(meshes[0]))
        self.assertEqual(len([name for name in os.listdir(self.path) if name.endswith(".ply")]), 1)

    def test_views_are_what_cameras_see(self):
        """A viewport that looks through the camera, its frame as large as the region."""
        width, height = 160, 90
        camera = self.scene.camera
        camera.rotation_euler = (1.4, 0.1, 0.3)
        self.scene.render.resolution_x, self.scene.render.resolution_y = width, height
        for kind in ("PERSP", "ORTHO"):
            camera.data.type, camera.data.shift_x, camera.data.shift_y, camera.data.ortho_scale = kind, 0.12, -0.2, 5
            bpy.context.view_layer.update()
            depsgraph = bpy.context.evaluated_depsgraph_get()
            projection = camera.calc_matrix_camera(depsgraph, x=width, y=height)
            context = types.SimpleNamespace(
                region=types.SimpleNamespace(width=width, height=height),
                region_data=types.SimpleNamespace(
                    view_perspective="CAMERA", is_perspective=kind == "PERSP", window_matrix=projection,
                    view_matrix=camera.matrix_world.normalized().inverted(),
                    perspective_matrix=projection @ camera.matrix_world.normalized().inverted(),
                ),
                space_data=types.SimpleNamespace(use_render_border=False),
            )  # fmt: skip
            self.assertEqual(region.place_of(context, self.scene), (0, 0, width, height))
            own, _ = region.camera_of(context, self.scene, depsgraph, (0, 0, width, height), 10.0)
            rendered = camera_table(depsgraph, camera.evaluated_get(depsgraph), None, width, height, 1.0, Notes())
            self.assertTrue(self.alike(own, rendered, "fov" if kind == "PERSP" else "width", "shift", "position", "up"))
            # Half of the region sees half of it.
            left, _ = region.camera_of(context, self.scene, depsgraph, (0, 0, width // 2, height), 10.0)
            wide, half = self.numbers(own), self.numbers(left)
            if kind == "ORTHO":
                self.assertAlmostEqual(half["width"][0], wide["width"][0] / 2, places=5)
            self.assertAlmostEqual(half["shift"][0], 2 * wide["shift"][0] - 0.5, places=5)
        # The render's border, where the camera's frame fills the region.
        render = self.scene.render
        render.use_border = True
        render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.25, 0.75, 0.0, 0.5
        for found, wanted in zip(region.place_of(context, self.scene), (40, 0, 120, 45)):
            self.assertAlmostEqual(found, wanted, delta=1)
        render.use_border = False
        # An orthographic view sees what lies behind it.
        context.region_data.view_perspective, context.region_data.view_matrix = "ORTHO", Matrix.Translation((0, 0, -3))
        own, _ = region.camera_of(context, self.scene, depsgraph, (0, 0, width, height), 10.0)
        np.testing.assert_allclose(self.numbers(own)["position"], [0, 0, 3 + 3 + 10], atol=1e-5)

    def numbers(self, table):
        return {key: np.atleast_1d(json.loads(text.partition(" = ")[2])) for key, text in table._lines.items() if '"' not in text}

    def alike(self, a, b, *keys):
        a, b = self.numbers(a), self.numbers(b)
        for key in keys:
            np.testing.assert_allclose(a[key], b[key], atol=2e-5, err_msg=key)
        return True


if __name__ == "__main__":
    scenes.run_tests(sys.modules[__name__])
