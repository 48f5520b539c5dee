"""The rendered viewport, in a Blender with a window on a display of Xvfb's with software OpenGL. Runs beside Blender, by Debian's
interpreter; skipped where there is no Xvfb.

    viewport_test.py BLENDER BRUME SOURCE [FOLDER for screenshots]
"""

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest

from running import runs

BLENDER, BRUME, SOURCE = sys.argv[1:4]
HERE = os.path.dirname(os.path.abspath(__file__))
PATIENCE = 600

BUILD = """
import sys
sys.path.insert(0, {tests!r})
import bpy, addon_scene as scenes
scenes.smoke_scene(width=640, height=480)
bpy.ops.wm.save_as_mainfile(filepath={path!r})
"""


class Viewport(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = sys.argv[4] if len(sys.argv) > 4 else tempfile.mkdtemp(prefix="brume_test_")
        if len(sys.argv) <= 4:
            cls.addClassCleanup(shutil.rmtree, cls.folder, ignore_errors=True)
        reading, writing = os.pipe()
        cls.display = subprocess.Popen(
            ["Xvfb", "-displayfd", str(writing), "-screen", "0", "900x640x24", "-nolisten", "tcp"],
            pass_fds=[writing], stderr=subprocess.DEVNULL,
        )  # fmt: skip
        os.close(writing)
        cls.addClassCleanup(cls.display.wait)
        cls.addClassCleanup(cls.display.terminate)
        with os.fdopen(reading) as file:
            number = file.readline().strip()
        cls.environment = {
            **os.environ, "DISPLAY": f":{number}", "BRUME_PROGRAM": BRUME, "BRUME_SOURCE": SOURCE, "LIBGL_ALWAYS_SOFTWARE": "1",
            "PYTHONDONTWRITEBYTECODE": "1", "TMPDIR": cls.folder,
        }  # fmt: skip
        scene = os.path.join(cls.folder, "scene.blend")
        words = [BLENDER, "-b", "--factory-startup", "--python-exit-code", "1", "--python-expr", BUILD.format(tests=HERE, path=scene)]
        subprocess.run(words, env=cls.environment, check=True, stdout=subprocess.DEVNULL)
        script = os.path.join(HERE, "viewport_window.py")
        words = [BLENDER, "--factory-startup", "-p", "0", "0", "900", "640", "--python", script, "--", scene, cls.folder]
        seen, log = os.path.join(cls.folder, "seen.json"), os.path.join(cls.folder, "log.txt")
        with open(log, "w") as file:
            blender = subprocess.Popen(words, env=cls.environment, stdout=file, stderr=subprocess.STDOUT)
        end = time.monotonic() + PATIENCE
        while not os.path.exists(seen) and blender.poll() is None and time.monotonic() < end:
            time.sleep(0.1)
        time.sleep(0.2)
        blender.send_signal(signal.SIGKILL)
        blender.wait()
        with open(log) as file:
            cls.log = file.read()
        if not os.path.exists(seen):
            raise AssertionError(f"Blender has seen nothing\n{cls.log}")
        with open(seen) as file:
            cls.seen = json.load(file)
        print(json.dumps(cls.seen, indent=1))

    def test_nothing_fails_and_no_traceback_is_printed(self):
        self.assertEqual(self.seen["failed"], [], self.log)
        self.assertNotIn("Traceback", self.log)

    def test_the_picture_lies_where_it_belongs_in_the_scenes_colours(self):
        for view in ("perspective", "clean", "camera", "ortho", "border"):
            self.assertLess(self.seen[view]["off"], 0.004, view)  # of bytes that were rounded
            self.assertGreater(self.seen[view]["mean"], 0.05, view)
        self.assertLess(self.seen["border"]["size"][0], 0.6 * self.seen["perspective"]["size"][0])

    def test_it_is_predicted_soon_and_clean_at_rest(self):
        self.assertLess(self.seen["first"], 20)  # under a second on a machine that does nothing else
        self.assertLess(self.seen["edit"], 20)
        self.assertGreater(self.seen["pictures_a_second"], 0.3)  # software OpenGL draws so fast
        self.assertEqual(self.seen["samples"], 8)

    def test_light_groups_are_mixed_without_rendering_again(self):
        mix = self.seen["mix"]
        self.assertEqual((mix["stage"], mix["samples"], mix["read_again"]), ("clean", 8, 0))
        self.assertLess(mix["seconds"], 10)  # a frame or two on a machine that does nothing else
        self.assertIn("8 samples", mix["state"])
        self.assertIn("lights mixed", mix["state"])
        self.assertLess(self.seen["mixed"]["off"], 0.004)
        for before, without, rendered, twice in zip(mix["before"], mix["without"], mix["rendered"], mix["twice"]):
            self.assertLess(without, 0.95 * before)
            self.assertAlmostEqual(without / rendered, 1, delta=0.03)  # as the scene whose lamp is off
            self.assertAlmostEqual(twice, 2, delta=0.002)
        self.assertTrue(mix["reset"])

    def test_only_what_changed_is_written_again(self):
        self.assertEqual(self.seen["meshes_written_again"], 0)
        self.assertEqual(len(self.seen["meshes"]), 1, "the floor as it is, not as it was")

    def test_volume_shaders_are_baked_beside_while_the_picture_stays(self):
        self.assertRegex(self.seen["baking"], r"^baking Smoke \.\.\. \| ")
        self.assertTrue(self.seen["stays_while_baking"])
        self.assertEqual(self.seen["cancelled"], [1], "the shader changed")
        self.assertFalse(self.seen["bakes_in_main_thread"])
        self.assertTrue(self.seen["baked"])
        self.assertEqual(self.seen["bakes"], 3, "what was baked before is known")

    def test_textures_are_painted_beside_while_the_picture_stays(self):
        self.assertRegex(self.seen["painting"], r"^baking Floor \.\.\. \| ")
        self.assertTrue(self.seen["stays_while_painting"])
        self.assertTrue(self.seen["painted"])
        self.assertFalse(self.seen["paints_in_main_thread"])
        self.assertEqual(self.seen["paintings"], 1, "another frame has the same texture")

    def test_transparent_films_have_alpha(self):
        self.assertLess(self.seen["alpha"][0], 0.01)
        self.assertGreater(self.seen["alpha"][1], 0.9)

    def test_problems_are_told_and_mended(self):
        self.assertIn("signal 9", self.seen["killed"])
        self.assertTrue(self.seen["started_again"])
        self.assertIn("missing.vdb is not there", self.seen["problem"])
        self.assertGreater(self.seen["problem_pixels"], 100, "written over the picture, as overlays are hidden")
        self.assertTrue(self.seen["mended"])

    def test_each_viewport_has_a_program_which_ends_with_it_and_with_blender(self):
        self.assertEqual(self.seen["viewports"], 2)
        self.assertEqual(self.seen["left"], [])
        end = time.monotonic() + 30
        while runs(self.seen["pid"]) and time.monotonic() < end:
            time.sleep(0.05)
        self.assertFalse(runs(self.seen["pid"]), "Blender was killed")


if __name__ == "__main__":
    if shutil.which("Xvfb") is None:
        print("skipped: there is no Xvfb (package xvfb)")
    else:
        unittest.main(argv=sys.argv[:1], verbosity=2)
