"""The manifest of the add-on as Blender 4.2 and later judge it, and the zip as they find it. Needs no Blender:

    manifest_test.py SOURCE [unittest's arguments]

The rules are those of Blender's own validator, at its strictest: scripts/addons_core/bl_pkg/cli/blender_ext.py of
Blender 4.2 to 5.0, pkg_manifest_known_keys_and_types and what is named below, written anew.
"""

import ast
import os
import re
import stat
import subprocess
import sys
import tempfile
import unittest
import zipfile

try:
    import tomllib
except ModuleNotFoundError:
    print("skipped: Python before 3.11 reads no TOML")
    sys.exit(0)

SOURCE = sys.argv[1]
ADDON = os.path.join(SOURCE, "apps", "blender", "brume_blender")
MANIFEST = "blender_manifest.toml"

SEMANTIC_VERSION = re.compile(r"(0|[1-9]\d*)\.(0|[1-9]\d*)\.(0|[1-9]\d*)(-[0-9A-Za-z.-]+)?(\+[0-9A-Za-z.-]+)?")
TERSE = 64  # characters
PERMISSIONS = {"files", "network", "clipboard", "camera", "microphone"}


def text_problem(value):  # ..._any_non_empty_string_stripped_no_control_chars
    if not value or value != value.strip() or re.search(r"[\x00-\x1f\x7f-\x9f]", value):
        return "expected a text without space around it and without control characters"


def terse_problem(value):  # pkg_manifest_validate_terse_description_or_error
    if len(value) > TERSE:
        return f"expected at most {TERSE} characters"
    return text_problem(value) or (None if value[-1].isalnum() or value[-1] in ")]}" else "must not end with punctuation")


def identifier_problem(value):  # pkg_idname_is_valid_or_error
    if not value.isidentifier() or "__" in value or value.startswith("_") or value.endswith("_"):
        return "expected a name with single underscores inside"


def version_problem(value):
    return None if SEMANTIC_VERSION.fullmatch(value) else "expected a semantic version"


def blender_version_problem(value):
    if not re.fullmatch(r"\d+\.\d+\.\d+", value):
        return "expected three numbers"
    if tuple(map(int, value.split("."))) < (4, 2, 0):
        return "extensions begin with Blender 4.2.0"


def list_problem(value):
    if not value or any(not isinstance(entry, str) or not entry.strip() for entry in value):
        return "expected a list of texts, not empty"


def copyright_problem(value):
    if any(not re.fullmatch(r"\d+(-\d+)? \S.*", entry) for entry in value):
        return "expected years and a name"


def permissions_problem(value):
    for name, why in value.items():
        if name not in PERMISSIONS:
            return f"{name} is no permission"
        if terse_problem(why):
            return f"{name}: {terse_problem(why)}"


RULES = {  # key: type, what is wrong with a value, whether it must be there
    "schema_version": (str, version_problem, True),
    "id": (str, identifier_problem, True),
    "version": (str, version_problem, True),
    "name": (str, text_problem, True),
    "tagline": (str, terse_problem, True),
    "maintainer": (str, text_problem, True),
    "type": (str, lambda value: None if value in ("add-on", "theme") else "expected add-on or theme", True),
    "license": (list, list_problem, True),
    "blender_version_min": (str, blender_version_problem, True),
    "blender_version_max": (str, blender_version_problem, False),
    "website": (str, text_problem, False),
    "copyright": (list, copyright_problem, False),
    "permissions": (dict, permissions_problem, False),
    "tags": (list, list_problem, False),
    "platforms": (list, list_problem, False),
    "wheels": (list, list_problem, False),
}


def problems(manifest):
    """What Blender would refuse; and keys that it would pass over, which are misspelt."""
    found = [f"unknown {key}" for key in manifest if key not in RULES and key != "build"]
    for key, (kind, problem, needed) in RULES.items():
        if key not in manifest:
            found += [f"missing {key}"] if needed else []
        elif not isinstance(manifest[key], kind):
            found.append(f"{key}: expected a {kind.__name__}")
        elif problem(manifest[key]):
            found.append(f"{key}: {problem(manifest[key])}")
    return found


def folder_of_manifest(names):  # pkg_zipfile_detect_subdir_or_none
    """Where in a zip Blender finds the extension: "" or one folder; None: it takes the zip for an old add-on."""
    if MANIFEST in names:
        return ""
    found = [name[: -len(MANIFEST)] for name in names if name.endswith("/" + MANIFEST) and not name.startswith(".")]
    return found[0] if len(found) == 1 else None


class Manifest(unittest.TestCase):
    def setUp(self):
        with open(os.path.join(ADDON, MANIFEST), "rb") as file:
            self.manifest = tomllib.load(file)

    def test_blender_takes_it(self):
        self.assertEqual(problems(self.manifest), [])

    def test_what_blender_refuses_is_found(self):
        for key, value in {
            "id": "brume__blender",
            "version": "0.1",
            "name": " brume",
            "tagline": "Ends with a full stop.",
            "type": "addon",
            "license": [],
            "blender_version_min": "3.4.0",
            "copyright": ["The brume authors"],
            "permissions": {"disk": "Reads files"},
            "platforms": "linux-x64",
            "tag": ["Render"],
        }.items():
            with self.subTest(key=key):
                self.assertEqual(len(problems({**self.manifest, key: value})), 1)
        for key in ("tagline", "maintainer", "schema_version"):
            self.assertEqual(problems({k: v for k, v in self.manifest.items() if k != key}), [f"missing {key}"])
        self.assertEqual(len(problems({**self.manifest, "tagline": "x" * 65})), 1)

    def test_versions_and_names_are_those_that_older_blenders_read(self):
        with open(os.path.join(ADDON, "__init__.py"), encoding="utf-8") as file:
            tree = ast.parse(file.read())
        assignment = next(node for node in tree.body if isinstance(node, ast.Assign) and node.targets[0].id == "bl_info")
        old = ast.literal_eval(assignment.value)
        self.assertEqual(self.manifest["version"], ".".join(map(str, old["version"])))
        self.assertEqual(self.manifest["name"], old["name"])
        self.assertEqual(self.manifest["maintainer"], old["author"])
        self.assertLess(old["blender"], (4, 2, 0))
        with open(os.path.join(SOURCE, "CMakeLists.txt"), encoding="utf-8") as file:
            self.assertIn(f"project(brume VERSION {self.manifest['version']} ", file.read())
        with open(os.path.join(SOURCE, "LICENSE"), encoding="utf-8") as file:
            self.assertEqual(file.readline().strip(), "MIT License")
        self.assertEqual(self.manifest["license"], ["SPDX:MIT"])

    def test_modules_find_one_another_under_any_name(self):
        """An extension is imported as bl_ext.user_default.brume_blender: no module may say the package's name."""
        for folder, _, files in os.walk(ADDON):
            for name in (f for f in files if f.endswith(".py")):
                with open(os.path.join(folder, name), encoding="utf-8") as file:
                    tree = ast.parse(file.read())
                for node in ast.walk(tree):
                    modules = [a.name for a in node.names] if isinstance(node, ast.Import) else []
                    if isinstance(node, ast.ImportFrom) and node.level == 0:
                        modules.append(node.module)
                    for module in modules:
                        self.assertNotEqual(module.partition(".")[0], "brume_blender", name)


class Zip(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="brume_test_")
        self.addCleanup(folder.cleanup)
        self.home = folder.name
        self.zip = os.path.join(self.home, "brume_blender.zip")

    def pack(self, *words):
        packer = os.path.join(SOURCE, "apps", "blender", "make_zip.py")
        return subprocess.run([sys.executable, packer, self.zip, *words], capture_output=True, text=True)

    def test_one_zip_is_an_extension_and_an_add_on(self):
        self.assertEqual(self.pack("/usr/bin/brume").returncode, 0)
        with zipfile.ZipFile(self.zip) as archive:
            names = archive.namelist()
            self.assertEqual(folder_of_manifest(names), "brume_blender/")
            self.assertEqual({name.partition("/")[0] for name in names}, {"brume_blender"}, "one folder, as add-ons have")
            self.assertIn("brume_blender/__init__.py", names)
            self.assertIn("brume_blender/translate/__init__.py", names)
            self.assertEqual(problems(tomllib.loads(archive.read("brume_blender/" + MANIFEST).decode())), [])
            self.assertEqual(archive.read("brume_blender/program_path.txt"), b"/usr/bin/brume\n")
        self.assertIsNone(folder_of_manifest(["brume_blender/__init__.py"]))
        self.assertIsNone(folder_of_manifest([f"a/{MANIFEST}", f"b/{MANIFEST}"]))

    def test_a_program_can_be_carried_along(self):
        for name in ("brume", "brume-vdb-reader"):
            with open(os.path.join(self.home, name), "w", encoding="utf-8") as file:
                file.write(name)
        self.assertEqual(self.pack(os.path.join(self.home, "brume"), "--carry").returncode, 0)
        with zipfile.ZipFile(self.zip) as archive:
            self.assertEqual(archive.read("brume_blender/bin/brume-vdb-reader"), b"brume-vdb-reader")
            mode = archive.getinfo("brume_blender/bin/brume").external_attr >> 16
            self.assertEqual(stat.S_IMODE(mode), 0o755)
            self.assertNotIn("brume_blender/program_path.txt", archive.namelist())
        os.remove(os.path.join(self.home, "brume-vdb-reader"))
        refused = self.pack(os.path.join(self.home, "brume"), "--carry")
        self.assertEqual(refused.returncode, 1)
        self.assertIn("brume-vdb-reader", refused.stderr)
        self.assertEqual(self.pack("--carry").returncode, 1)


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *sys.argv[2:]], verbosity=2)
