"""Signatures, stubs and help: what the package says of itself."""

import ast
import inspect
import json
import pathlib
import pickle
import unittest
import urllib.request

import brume
from support import CLOUD, run


class Declarations(unittest.TestCase):
    def test_filters_are_those_of_the_command_line(self):
        self.assertEqual(brume.filters(), json.loads(run("filters", "--json"))["filters"])

    def test_help_and_stubs_have_every_filter_and_parameter(self):
        stub = ast.parse((pathlib.Path(brume.__file__).parent / "__init__.pyi").read_text())
        overloads = {}
        for node in stub.body:
            if isinstance(node, ast.FunctionDef) and node.name == "denoise":
                arguments = {a.arg.rstrip("_") for a in node.args.args + node.args.kwonlyargs}
                kind = ast.unparse(next(a for a in node.args.args if a.arg == "filter").annotation)
                overloads[kind] = arguments
        for entry in brume.filters():
            wanted = {p["name"].replace("-", "_") for p in entry["parameters"]}
            self.assertLessEqual(wanted, overloads[f"Literal[{entry['name']!r}]"])
            self.assertIn(entry["name"] + ": " + entry["summary"], brume.denoise.__doc__)
            for parameter in entry["parameters"]:
                self.assertIn(f"    {parameter['name']}: {parameter['help']}", brume.denoise.__doc__)

    def test_stubs_name_what_the_package_has(self):
        stub = ast.parse((pathlib.Path(brume.__file__).parent / "__init__.pyi").read_text())
        named = {node.name for node in stub.body if isinstance(node, (ast.FunctionDef, ast.ClassDef))}
        self.assertEqual(named, set(brume.__all__))
        for kind in (brume.Layers, brume.Scene):
            stubs = next(n for n in stub.body if isinstance(n, ast.ClassDef) and n.name == kind.__name__)
            methods = {n.name for n in stubs.body if isinstance(n, ast.FunctionDef)}
            self.assertLessEqual({n for n in vars(kind) if not n.startswith("_")}, methods)

    def test_everything_public_has_a_signature(self):
        public = [getattr(brume, name) for name in brume.__all__ if name != "InputError"]
        public += [member for kind in (brume.Layers, brume.Scene) for name, member in vars(kind).items()
                   if callable(member) and not name.startswith("_")]
        self.assertGreater(len(public), 20)
        for thing in public:
            parameters = inspect.signature(thing).parameters
            self.assertTrue(inspect.getdoc(thing).strip(), thing)
            for name in parameters:
                self.assertNotRegex(name, "^arg[0-9]", thing)
        self.assertEqual(
            str(inspect.signature(brume.write)).replace("'", ""), "(path: object, layers: object) -> None"
        )
        self.assertIs(inspect.signature(brume.render).parameters["statistics"].default, True)
        inspect.signature(brume.render).bind("cloud.toml", spp=4, camera__fov=30)
        with self.assertRaises(TypeError):
            inspect.signature(brume.read).bind()
        self.assertEqual(list(inspect.signature(brume.Layers).parameters), ["channels", "header", "like"])
        self.assertEqual(list(inspect.signature(brume.Scene).parameters), ["scene", "kwargs"])
        inspect.signature(brume.Scene.render).bind(None, spp=4, on_picture=print, camera__fov=30)
        of_scene = inspect.signature(brume.Scene.render).parameters
        self.assertEqual(list(of_scene)[1:], list(inspect.signature(brume.render).parameters)[1:])
        inspect.signature(brume.InputError)

    def test_everything_public_can_be_pickled_by_its_name(self):
        for name in brume.__all__:
            thing = getattr(brume, name)
            self.assertIs(pickle.loads(pickle.dumps(thing)), thing)
            self.assertEqual(thing.__module__, "brume")
        self.assertIs(pickle.loads(pickle.dumps(brume.Scene.render)), brume.Scene.render)

    def test_help_says_what_is_raised(self):
        for name in set(brume.__all__) - {"InputError", "Layers", "filters"}:
            self.assertIn("Raises InputError", " ".join(inspect.getdoc(getattr(brume, name)).split()), name)

    def test_a_view_is_served_until_the_end(self):
        address = brume.view(CLOUD, camera__fov=20)
        self.assertRegex(address, r"^http://127\.0\.0\.1:[0-9]+/[0-9a-f]{32}/$")
        with urllib.request.urlopen(address + "scene.toml") as answer:
            self.assertEqual(answer.status, 200)
        with self.assertRaisesRegex(brume.InputError, "no such file"):
            brume.view("missing.toml")

    def test_the_version_is_the_programs(self):
        self.assertEqual(run("--version").split()[1], brume.__version__)


if __name__ == "__main__":
    unittest.main()
