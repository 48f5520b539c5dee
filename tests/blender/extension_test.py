"""The add-on as Blender 4.2 and later install it: unpacked as an extension, imported as bl_ext.user_default.brume_blender.
Inside Blender, without a window, of any version."""

import importlib
import os
import shutil
import subprocess
import sys
import types
import unittest
import zipfile

import bpy

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import addon_scene as scenes  # noqa: E402

NAME = "bl_ext.user_default.brume_blender"
PROGRAM = os.environ["BRUME_PROGRAM"]


def unpack(archive, repository):
    """As blender_ext.py does: the folder that holds the manifest becomes one of the extension's id, modes are lost."""
    with zipfile.ZipFile(archive) as file:
        for member in file.infolist():
            member.filename = member.filename.partition("/")[2]
            file.extract(member, os.path.join(repository, "brume_blender"))


def import_from(repository):
    """The packages that Blender makes for its repositories."""
    for name, path in (("bl_ext", []), ("bl_ext.user_default", [repository])):
        package = types.ModuleType(name)
        package.__path__ = path
        sys.modules[name] = package
    return importlib.import_module(NAME)


class Extension(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = scenes.folder()
        cls.addClassCleanup(folder.cleanup)
        cls.home = folder.name
        archive = os.path.join(cls.home, "brume_blender.zip")
        packer = os.path.join(scenes.SOURCE, "apps", "blender", "make_zip.py")
        python = shutil.which("python3", path="/usr/bin") or sys.executable
        subprocess.run([python, packer, archive, PROGRAM, "--carry"], check=True, stdout=subprocess.DEVNULL)
        cls.repository = os.path.join(cls.home, "user_default")
        unpack(archive, cls.repository)
        bpy.ops.wm.read_factory_settings(use_empty=True)
        cls.module = import_from(cls.repository)
        addon = bpy.context.preferences.addons.new()
        addon.module = NAME
        cls.module.register()
        cls.addClassCleanup(cls.module.unregister)

    def part(self, name):
        return sys.modules[f"{NAME}.{name}"]

    def test_its_preferences_are_found_under_its_long_name(self):
        preferences = bpy.context.preferences.addons[NAME].preferences
        self.assertEqual(type(preferences).bl_idname, NAME)
        preferences.program = "/nowhere/brume"
        try:
            self.assertEqual(self.part("properties").preferred_program(), "/nowhere/brume")
        finally:
            preferences.program = ""

    def test_the_carried_program_runs_although_unpacking_lost_its_mode(self):
        program = self.part("program")
        paths = [program.BUNDLED, program.BUNDLED_READER]
        self.assertTrue(all(path.startswith(self.repository) for path in paths))
        for path in paths:
            os.chmod(path, 0o644)
        said = os.environ.pop("BRUME_PROGRAM")
        try:
            self.assertEqual(program.find(), program.BUNDLED)
        finally:
            os.environ["BRUME_PROGRAM"] = said
        for path in paths:
            self.assertTrue(os.access(path, os.X_OK), path)

    def test_it_renders(self):
        scene = bpy.context.scene
        scene.render.engine = "BRUME"
        scene.render.resolution_x, scene.render.resolution_y = 32, 24
        scene.render.image_settings.file_format = "OPEN_EXR_MULTILAYER"
        scene.brume.samples = 2
        scenes.add_camera()
        scenes.add_smoke()
        scenes.add_sky()
        frame = scenes.render(os.path.join(self.home, "frame.exr"))
        picture = frame.layer("ViewLayer.Combined", "RGB")
        self.assertEqual(picture.shape, (24, 32, 3))
        self.assertGreater(picture.mean(), 0.1)
        self.assertEqual(bpy.ops.brume.preset(preset="preview"), {"FINISHED"})

    def test_an_older_copy_beside_it_is_told(self):
        addon = bpy.context.preferences.addons.new()
        addon.module = "brume_blender"
        try:
            with self.assertRaisesRegex(RuntimeError, "enabled as brume_blender, too: disable one"):
                self.module.register()
        finally:
            bpy.context.preferences.addons.remove(addon)

    def test_no_module_is_loaded_under_its_short_name(self):
        own = [name for name in sys.modules if name.startswith(NAME + ".")]
        self.assertGreater(len(own), 10)
        for name in own:
            self.assertTrue(sys.modules[name].__file__.startswith(self.repository), name)


if __name__ == "__main__":
    scenes.run_tests(sys.modules[__name__])
