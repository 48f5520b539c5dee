"""Writes what describes the Python package beside its module: type stubs, the marker py.typed and metadata.

usage: describe.py FOLDER, which has the package brume. Everything comes from what the module declares.
"""

import inspect
import keyword
import pathlib
import re
import sys

# What pybind11 calls "object", by the argument's name.
ARGUMENT_TYPES = {
    "path": "Path",
    "channels": "Iterable[str] | str | None",
    "layers": "Frame",
    "header": "Mapping[str, Attribute] | None",
    "like": "Layers | None",
    "picture": "Frame",
    "reference": "Frame",
    "second": "Frame | None",
    "scene": "Path",
    "spp": "int | None",
    "seed": "int | None",
    "clean": "bool | str",
    "frames": "str | None",
    "crop": "tuple[int, int, int, int] | None",
    "progress": "Callable[[float], object] | None",
    "filter": "str | None",
    "features": "Iterable[str] | str | None",
    "carry": "Iterable[str] | str",
    "guides": "Path | Layers | None",
    "experiment": "Path | Iterable[Path]",
    "filters": "Mapping[str, Filter | str] | Iterable[Filter | str] | Filter | str | None",
    "output": "Path | None",
    "cache": "Path | None",
    "size": "int | None",
    "seeds": "int | None",
    "reference_spp": "int | None",
    "component": "str | None",
    "background": "str | None",
    "search": "bool | None",
    "exposure": "float | str",
    "array": "npt.ArrayLike",
    "name": "str",
    "default": "Any",
}
# Where a name means something else in one place.
SPECIAL_TYPES = {
    ("render", "layers"): "Iterable[str] | str | None",
    ("evaluate", "spp"): "Iterable[int] | int | None",
    ("Layers.__init__", "channels"): "Frame",
    ("Layers.__contains__", "arg0"): "object",
    ("Layers.__setitem__", "arg1"): "npt.ArrayLike",
}
RETURN_TYPES = {
    "filters": "list[dict[str, Any]]",
    "metrics": "dict[str, Any]",
    "evaluate": "dict[str, Any]",
    "Layers.__getitem__": "Channel",
    "Layers.__iter__": "Iterator[str]",
    "Layers.keys": "list[str]",
    "Layers.values": "list[Channel]",
    "Layers.items": "list[tuple[str, Channel]]",
    "Layers.image": "Channel",
    "Layers.layers": "list[str]",
    "Layers.get": "Any",
}
PROPERTY_TYPES = {
    "width": "int",
    "height": "int",
    "shape": "tuple[int, int]",
    "data_window": "tuple[int, int, int, int]",
    "display_window": "tuple[int, int, int, int]",
    "header": "dict[str, Any]",
}
PLACED = "def {name}({arguments}) -> {result}:"

HEAD = '''"""{summary}"""

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, Literal, overload

import numpy as np
import numpy.typing as npt

Path = str | bytes | os.PathLike[str]
Channel = npt.NDArray[np.float32]
Attribute = str | int | float | npt.ArrayLike

__version__: str
__commit__: str

class InputError(ValueError):
    """{error}"""

'''


def quoted(text, indent):
    """A docstring, indented."""
    lines = text.strip().replace("\\", "\\\\").replace('"""', "'''").split("\n")
    return f"\n".join([indent + '"""' + lines[0]] + [indent + line if line else "" for line in lines[1:]]) + (
        '"""' if len(lines) == 1 else f'\n{indent}"""'
    )


def signature(owner, function):
    """Arguments, as (text before the colon, type, default), and result of a function of the module; its text."""
    first, _, text = (function.__doc__ or "").partition("\n")
    if first.startswith("__contains__"):  # overloaded
        first, text = "__contains__(self, arg0: object) -> bool", ""
    found = re.match(r"(\w+)\((.*)\) -> (.*)$", first)
    name, inside, result = found.groups()
    where = owner + name
    arguments = []
    for part in re.findall(r"(?:[^,(\[]|\([^)]*\)|\[[^\]]*\])+", inside):
        words = re.match(r"\s*(\*{0,2}\w*)(?:: ([^=]+?))?(?:\s*=\s*(.*))?$", part)
        argument, kind, default = words.groups()
        if argument in ("self", "*"):
            arguments.append((argument, None, None))
        elif argument.startswith("**"):
            arguments.append((argument, "Any", None))
        else:
            kind = SPECIAL_TYPES.get((where, argument)) or (
                ARGUMENT_TYPES.get(argument, kind) if kind in ("object", None) or argument == "layers" else kind
            )
            arguments.append((argument, kind, default))
    if arguments and owner and arguments[0][0] != "self":
        arguments[0] = ("self", None, None)
    result = RETURN_TYPES.get(where, result.replace("brume._brume.", "").replace("brume.", ""))
    return name, arguments, result, text


def written(arguments):
    texts = []
    for name, kind, default in arguments:
        text = name + (f": {kind}" if kind else "")
        texts.append(text + (f" = {default}" if default is not None else ""))
    return ", ".join(texts)


def function_stub(owner, function, indent=""):
    name, arguments, result, text = signature(owner, function)
    head = indent + PLACED.format(name=name, arguments=written(arguments), result=result)
    body = quoted(text, indent + "    ") + "\n" if text.strip() else ""
    return f"{head}\n{body}{indent}    ...\n"


def class_stub(cls):
    lines = ["class Layers(Mapping[str, Channel]):", quoted(cls.__doc__, "    "), ""]
    for name, member in sorted(vars(cls).items()):
        if isinstance(member, property):
            lines.append(f"    @property\n    def {name}(self) -> {PROPERTY_TYPES[name]}:")
            lines.append(quoted(member.__doc__, "        ") + "\n        ...")
            if member.fset:
                lines.append(f"    @{name}.setter\n    def {name}(self, value: Mapping[str, Attribute]) -> None: ...")
        elif callable(member) and (not name.startswith("_") or name in ("__init__", "__contains__", "__getitem__",
                                                                        "__setitem__", "__iter__", "__len__")):
            lines.append(function_stub("Layers.", member, "    "))
    return "\n".join(lines) + "\n"


def parameter_of(p):
    """A filter's parameter as a keyword argument."""
    name = p["name"].replace("-", "_")
    name += "_" if keyword.iskeyword(name) else ""
    kind = "Literal[{}]".format(", ".join(map(repr, p["choices"]))) if "choices" in p else "float"
    return name, kind, repr(p["default"])


def denoise_stubs(brume):
    """One signature for each filter, with its parameters, and one for the recommended filter."""
    name, arguments, result, text = signature("", brume.denoise)
    common = [a for a in arguments if not a[0].startswith("**")]
    stubs = []
    for entry in [None] + brume.filters():
        own = list(common)
        at = [a[0] for a in own].index("filter")
        if entry is None:
            own[at] = ("filter", "None", "None")
        else:
            own[at] = ("filter", f"Literal[{entry['name']!r}]", None)
            own += [parameter_of(p) for p in entry["parameters"]] + [("preset", "str", "...")]
        summary = "With the best filter that the frame's layers allow." if entry is None else entry["summary"]
        head = PLACED.format(name=name, arguments=written(own), result=result)
        stubs.append(f"@overload\n{head}\n{quoted(summary, '    ')}\n    ...\n")
    head = PLACED.format(name=name, arguments=written(arguments), result=result)
    stubs.append(f"@overload\n{head}\n{quoted(text, '    ')}\n    ...\n")
    return "\n".join(stubs)


def stubs(brume):
    parts = [HEAD.format(summary=inspect.getdoc(brume).split("\n")[0], error=brume.InputError.__doc__)]
    parts.append(class_stub(brume.Layers))
    parts.append("Frame = Layers | Mapping[str, npt.ArrayLike] | npt.NDArray[Any]\n")
    parts.append("Filter = Callable[[Layers], Frame]\n")
    for name in brume.__all__:
        if name == "denoise":
            parts.append(denoise_stubs(brume))
        elif not isinstance(getattr(brume, name), type):
            parts.append(function_stub("", getattr(brume, name)))
    return "\n".join(parts)


def main():
    folder = pathlib.Path(sys.argv[1])
    sys.path.insert(0, str(folder))
    sys.dont_write_bytecode = True
    import brume

    (folder / "brume/__init__.pyi").write_text(stubs(brume))
    (folder / "brume/py.typed").write_text("")
    info = folder / f"brume-{brume.__version__}.dist-info"
    info.mkdir(exist_ok=True)
    (info / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: brume\nVersion: {brume.__version__}\n"
        f"Summary: {inspect.getdoc(brume).split(chr(10))[0]}\nRequires-Python: >=3.9\nRequires-Dist: numpy\n"
    )
    (info / "top_level.txt").write_text("brume\n")


main()
