"""Blender and the program as processes: installed from the zip, animations on the command line, cancelling, killed, two at
once. Runs beside Blender, by Debian's interpreter:

    processes_test.py BLENDER BRUME SOURCE [unittest's arguments]
"""

import glob
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
import unittest

import numpy as np
from running import runs

BLENDER, BRUME, SOURCE = sys.argv[1:4]
sys.path.insert(0, os.path.join(SOURCE, "apps", "blender", "brume_blender"))
import exr  # noqa: E402

PATIENCE = 300  # seconds after which a test gives up, whatever the machine

BUILD = """
import os, sys
sys.path.insert(0, {tests!r})
os.environ["BRUME_SOURCE"] = {source!r}
import bpy, addon_scene as scenes
scene = scenes.smoke_scene(width=64, height=48, {arguments})
lamp = bpy.data.objects["Lamp"]
for frame, x in ((1, 3), (4, -3)):
    lamp.location.x = x
    lamp.keyframe_insert("location", frame=frame)
scene.frame_start, scene.frame_end = 1, 4
{more}
bpy.ops.wm.save_as_mainfile(filepath={path!r}, relative_remap=False)
"""

INSTALL = """
import bpy
bpy.ops.preferences.addon_install(filepath={zip!r})
bpy.ops.preferences.addon_enable(module="brume_blender")
bpy.ops.wm.save_userpref()
"""


def children_of(pid):
    """Process numbers of the programs that a process has started."""
    found = []
    for path in glob.glob("/proc/[0-9]*/stat"):
        try:
            with open(path) as file:
                stat = file.read()
        except OSError:
            continue
        state, parent = stat.rpartition(")")[2].split()[:2]
        if int(parent) == pid and state != "Z":
            found.append(int(path.split("/")[2]))
    return found


def wait_until(condition, what):
    end = time.monotonic() + PATIENCE
    while not condition():
        if time.monotonic() > end:
            raise AssertionError(f"waited in vain for {what}")
        time.sleep(0.02)


class Processes(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        """A Blender of our own settings with the add-on installed from its zip, and the files that it renders."""
        home = tempfile.TemporaryDirectory(prefix="brume_test_")
        cls.addClassCleanup(home.cleanup)
        cls.home = home.name
        cls.environment = {key: value for key, value in os.environ.items() if not key.startswith(("BRUME_", "BLENDER_"))}
        for kind in ("CONFIG", "SCRIPTS", "DATAFILES"):
            cls.environment[f"BLENDER_USER_{kind}"] = os.path.join(cls.home, kind)
            os.mkdir(os.path.join(cls.home, kind))
        archive = os.path.join(cls.home, "brume_blender.zip")
        packer = os.path.join(SOURCE, "apps", "blender", "make_zip.py")
        subprocess.run([sys.executable, packer, archive, BRUME], check=True, stdout=subprocess.DEVNULL)
        cls.blender("--factory-startup", "--python-exit-code", "1", "--python-expr", INSTALL.format(zip=archive))
        for number in range(1, 5):
            vdb = cls.path(f"cloud_{number:04}.vdb")
            words = ["generate", "cloud", "--resolution", "24", "--seed", str(number), "-q", "-o", vdb]
            subprocess.run([BRUME, *words], check=True, stdout=subprocess.DEVNULL)
        cls.scene("still.blend", "")
        cls.scene("heavy.blend", "", "scene.brume.samples = 1 << 20; scene.render.resolution_percentage = 400")
        cloud = f"path={cls.path('cloud_0001.vdb')!r}, grid='density'"
        sequence = "v = bpy.data.volumes[0]; v.is_sequence = True; v.frame_start, v.frame_duration = 1, 4"
        cls.scene("sequence.blend", cloud, sequence)
        cls.scene("second.blend", cloud.replace("cloud_0001", "cloud_0002"))

    def setUp(self):
        self.temporary = tempfile.mkdtemp(dir=self.home)
        self.environment["TMPDIR"] = self.temporary

    @classmethod
    def path(cls, name):
        return os.path.join(cls.home, name)

    @classmethod
    def blender(cls, *words):
        """Runs it to its end. @return what it printed"""
        told = subprocess.run(
            [BLENDER, "-b", *words], env=cls.environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=PATIENCE
        )
        if told.returncode != 0:
            raise AssertionError(f"blender {words}: status {told.returncode}\n{told.stdout}")
        return told.stdout

    @classmethod
    def scene(cls, name, arguments, more=""):
        tests = os.path.join(SOURCE, "tests", "blender")
        text = BUILD.format(tests=tests, source=SOURCE, arguments=arguments, more=more, path=cls.path(name))
        cls.blender("--factory-startup", "--python-exit-code", "1", "--python-expr", text)

    def start(self, *words):
        """Blender, running. @return its process and the file that it prints into"""
        printed = tempfile.NamedTemporaryFile(dir=self.home, suffix=".txt")
        process = subprocess.Popen([BLENDER, "-b", *words], env=self.environment, stdout=printed, stderr=subprocess.STDOUT)
        self.addCleanup(process.wait)
        self.addCleanup(process.kill)
        return process, printed

    def printed(self, file):
        """The end of what Blender has printed."""
        with open(file.name) as again:
            return again.read()[-20000:]

    def rendering(self, output="heavy_####"):
        """Blender in the middle of a heavy render, and the program's process number."""
        process, printed = self.start(self.path("heavy.blend"), "-E", "BRUME", "-o", self.path(output), "-f", "1")
        wait_until(lambda: " samples |" in self.printed(printed) or process.poll() is not None, "a first picture")
        self.assertIsNone(process.poll(), self.printed(printed))
        (child,) = children_of(process.pid)
        return process, printed, child

    def frame(self, name):
        return exr.read(self.path(name)).layer("ViewLayer.Combined", "RGB")

    def test_an_animation_on_the_command_line(self):
        """The lamp moves, the volume is another file in each frame, and each frame is as it is alone."""
        self.blender(self.path("sequence.blend"), "-E", "BRUME", "-o", self.path("shot_####"), "-s", "1", "-e", "3", "-a")
        self.assertEqual(len(glob.glob(self.path("shot_*.exr"))), 3)
        frames = [self.frame(f"shot_000{number}.exr") for number in (1, 2, 3)]
        for a, b in ((0, 1), (1, 2)):
            self.assertGreater(np.abs(frames[a] - frames[b]).mean(), 0.003)
        self.blender(self.path("sequence.blend"), "-E", "BRUME", "-o", self.path("alone_####"), "-f", "2")
        np.testing.assert_array_equal(self.frame("alone_0002.exr"), frames[1])
        self.blender(self.path("second.blend"), "-E", "BRUME", "-o", self.path("second_####"), "-f", "2")
        np.testing.assert_array_equal(self.frame("second_0002.exr"), frames[1])
        self.assertEqual(os.listdir(self.temporary), [])

    def test_a_cancelled_render_ends_its_program(self):
        process, printed, child = self.rendering("cancelled_####")
        began = time.monotonic()
        process.send_signal(signal.SIGINT)  # Esc of a Blender without a window
        wait_until(lambda: not runs(child), "the program's end")
        seconds = time.monotonic() - began
        process.wait(PATIENCE)
        print(f"the program ended {seconds:.2f} s after Blender was told to stop")
        self.assertIn("brume | cancelled", self.printed(printed))
        self.assertEqual(os.listdir(self.temporary), [])

    def test_a_killed_blender_leaves_no_program_behind(self):
        process, _, child = self.rendering()
        began = time.monotonic()
        process.kill()
        wait_until(lambda: not runs(child), "the program's end")
        print(f"the program ended {time.monotonic() - began:.2f} s after Blender was killed")

    def test_two_renders_of_one_file_do_not_meet(self):
        words = [self.path("still.blend"), "-E", "BRUME"]
        both = [self.start(*words, "-o", self.path(f"{name}_####"), "-s", "1", "-e", "2", "-a") for name in "ab"]
        for process, printed in both:
            self.assertEqual(process.wait(PATIENCE), 0, self.printed(printed))
        self.blender(*words, "-o", self.path("c_####"), "-f", "2")
        for name in "ab":
            np.testing.assert_array_equal(self.frame(f"{name}_0002.exr"), self.frame("c_0002.exr"))

    def test_a_frame_that_fails_ends_the_animation_with_its_message_and_without_a_picture(self):
        """A volume that is damaged in one frame of a sequence: no black picture passes for that frame."""
        os.rename(self.path("cloud_0002.vdb"), self.path("kept.vdb"))
        self.addCleanup(os.replace, self.path("kept.vdb"), self.path("cloud_0002.vdb"))
        with open(self.path("cloud_0002.vdb"), "wb") as file, open(self.path("kept.vdb"), "rb") as good:
            file.write(good.read()[:5000])
        with self.assertRaisesRegex(AssertionError, r"status 1(.|\n)*Error: .*cloud_0002\.vdb: truncated"):
            self.blender(self.path("sequence.blend"), "-E", "BRUME", "-o", self.path("damaged_####"), "-s", "1", "-e", "3", "-a")
        self.assertGreater(self.frame("damaged_0001.exr").mean(), 0.01)
        self.assertEqual([n for n in (2, 3) if os.path.exists(self.path(f"damaged_000{n}.exr"))], [])

    def test_the_command_that_cleans_an_animation(self):
        cycles = "import bpy; s = bpy.context.scene; s.cycles.samples = 4; s.cycles.use_denoising = False"
        self.blender(
            self.path("still.blend"), "-E", "CYCLES", "--python-expr", cycles, "-o", self.path("noisy_####"), "-s", "1", "-e", "2", "-a"
        )
        script = os.path.join(SOURCE, "apps", "blender", "clean_animation.py")
        words = [self.path("still.blend"), "--python-exit-code", "1", "--python", script, "--"]
        told = self.blender(*words, "frames=" + self.path("noisy_####.exr"), "range=1-2")
        self.assertIn("2 frames are clean", told)
        for number in (1, 2):
            noisy, clean = (exr.read(self.path(f"noisy_{s}000{number}.exr")) for s in ("", "clean_"))
            self.assertEqual(sorted(noisy.channels), sorted(clean.channels))
            change = noisy.layer("ViewLayer.Combined", "RGB") - clean.layer("ViewLayer.Combined", "RGB")
            self.assertGreater(np.abs(change).mean(), 0.001)
        for words_too, message in (("frames=/nowhere/x_####.exr", "is not there"), ("rnage=1-2", "expected frames=")):
            with self.assertRaisesRegex(AssertionError, re.escape(message)):
                self.blender(*words, words_too)

    def test_a_cancelled_cleaning_leaves_the_files(self):
        self.test_the_command_that_cleans_an_animation()
        for name in glob.glob(self.path("noisy_clean_*")):
            os.remove(name)
        with open(self.path("noisy_0001.exr"), "rb") as file:
            before = file.read()
        script = os.path.join(SOURCE, "apps", "blender", "clean_animation.py")
        process, printed = self.start(
            self.path("still.blend"), "--python", script, "--", "frames=" + self.path("noisy_####.exr"), "range=1-2", "suffix="
        )
        wait_until(lambda: children_of(process.pid) or process.poll() is not None, "the program")
        process.kill()
        process.wait()
        with open(self.path("noisy_0001.exr"), "rb") as file:
            self.assertEqual(file.read() == before, True, self.printed(printed))


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *sys.argv[4:]], verbosity=2)
