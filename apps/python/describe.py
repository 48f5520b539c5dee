"""Writes what describes the Python package beside its module: type stubs, the marker py.typed and metadata.

usage: describe.py FOLDER, which has the package brume. Everything comes from what the module declares.
"""

import inspect
import keyword
import pathlib
import re
import sys

LAYER_NAMES = "Iterable[str] | str | None"
# What pybind11 calls "object", by the argument's name.
ARGUMENT_TYPES = {
    "path": "Path",
    "channels": "Iterable[str] | str | None",
    "layers": "Frame",
    "header": "Mapping[str, Attribute] | None",
    "like": "Layers | None",
    "picture": "Frame | Path",
    "reference": "Frame | Path",
    "second": "Frame | Path | None",
    "scene": "SceneLike",
    "spp": "int | None",
    "seed": "int | None",
    "clean": "bool | str",
    "frames": "str | None",
    "crop": "tuple[int, int, int, int] | None",
    "time": "float | None",
    "target_error": "float | None",
    "part": "tuple[int, int] | None",
    "output": "Path | None",
    "png": "Path | None",
    "records": "Path | None",
    "deep": "Path | None",
    "checkpoint": "Path | None",
    "resume": "Path | bool | None",
    "on_picture": "Callable[[Layers, dict[str, Any]], object] | None",
    "progress": "Callable[[float], object] | None",
    "filter": "str | None",
    "features": "Iterable[str] | str | None",
    "carry": "Iterable[str] | str",
    "guides": "Path | Layers | None",
    "second_frame": "Path | Layers | None",
    "experiment": "Path | Iterable[Path]",
    # Not Iterable, which a mapping with anything as its values is, too.
    "filters": "Mapping[str, Filter | str] | Sequence[Filter | str] | Filter | str | None",
    "output": "Path | None",
    "cache": "Path | None",
    "size": "int | None",
    "seeds": "int | None",
    "reference_spp": "int | None",
    "component": "str | None",
    "background": "str | None",
    "search": "bool | None",
    "exposure": "float | str",
    "extra_frames": "int | None",
    "frame_numbers": "str | None",
    "map": "Path | None",
    "samples": "int | None",
    "volume": "Path | None",
    "parts": "Layers | Path | Iterable[Layers | Path]",
    "numbers": "str | None",
    "contact_sheet": "Path | None",
    "array": "npt.ArrayLike",
    "name": "str",
    "default": "Any",
}
# Where a name means something else in one place.
SPECIAL_TYPES = {
    ("render", "layers"): LAYER_NAMES,
    ("Scene.render", "layers"): LAYER_NAMES,
    ("Scene.explain", "layers"): LAYER_NAMES,
    ("denoise", "layers"): "Frame | Path",
    ("guides", "like"): "Frame | Path",
    ("mix", "frame"): "Frame | Path",
    ("mix", "gain"): "Mapping[str, float]",
    ("mix", "colour"): "Mapping[str, Sequence[float]]",
    ("guides", "scene"): "SceneLike | None",
    ("view", "scene"): "Path",
    ("compare", "picture"): "Frames",
    ("compare", "reference"): "Frames",
    ("compare", "second"): "Frames | None",
    ("evaluate", "spp"): "Iterable[int] | int | None",
    ("Layers.__init__", "channels"): "Frame",
    ("Layers.__contains__", "arg0"): "object",
    ("Layers.__setitem__", "arg1"): "npt.ArrayLike",
    ("Scene.__contains__", "arg0"): "object",
    ("Scene.__getitem__", "arg0"): "str",
}
RETURN_TYPES = {
    "compare": "dict[str, Any]",
    "filters": "list[dict[str, Any]]",
    "metrics": "dict[str, Any]",
    "evaluate": "dict[str, Any]",
    "render": "Layers",
    "denoise": "Layers",
    "Layers.__getitem__": "Channel",
    "Layers.__iter__": "Iterator[str]",
    "Layers.keys": "list[str]",
    "Layers.values": "list[Channel]",
    "Layers.items": "list[tuple[str, Channel]]",
    "Layers.image": "Channel",
    "Layers.light": "Channel",
    "Layers.matte": "Channel",
    "Layers.mattes": "dict[str, list[str]]",
    "Layers.layers": "list[str]",
    "Layers.get": "Any",
    "Scene.__getitem__": "Any",
    "Scene.__iter__": "Iterator[str]",
    "Scene.keys": "list[str]",
    "Scene.render": "Layers",
}
PROPERTY_TYPES = {
    "width": "int",
    "height": "int",
    "shape": "tuple[int, int]",
    "data_window": "tuple[int, int, int, int]",
    "display_window": "tuple[int, int, int, int]",
    "header": "dict[str, Any]",
    "settings": "dict[str, Any]",
    "text": "str",
    "counts": "dict[str, int]",
}
NO_VIEWS = "  # type: ignore[override]  # lists, where other mappings give views"
BASES = {"Layers": "Mapping[str, Channel]"}
SPECIAL_METHODS = ("__init__", "__contains__", "__getitem__", "__setitem__", "__iter__", "__len__")
# What a sequence gives: a keyword that is then required, and the result.
FRAME_NUMBERS = "dict[str, list[int]]"
PLACED = "def {name}({arguments}) -> {result}:"

HEAD = '''"""{summary}"""

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, Literal, Union, overload

import numpy as np
import numpy.typing as npt

Path = str | bytes | os.PathLike[str]
Channel = npt.NDArray[np.float32]
Attribute = str | int | float | npt.ArrayLike
Frame = Union["Layers", Mapping[str, npt.ArrayLike], npt.NDArray[Any]]
Filter = Callable[["Layers"], Frame]
Frames = Frame | Path | list[Any] | tuple[Any, ...]
SceneLike = Union[Path, Mapping[str, Any], "Scene"]

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
        elif argument.startswith("*"):
            arguments.append((argument, "str", None))
        else:
            kind = SPECIAL_TYPES.get((where, argument)) or (
                ARGUMENT_TYPES.get(argument, kind) if kind in ("object", None) or argument == "layers" else kind
            )
            arguments.append((argument, kind, default))
    if arguments and owner and arguments[0][0] != "self":
        arguments[0] = ("self", None, None)
    if where.endswith("__init__"):
        result = "None"
    result = RETURN_TYPES.get(where, result.replace("brume._brume.", "").replace("brume.", ""))
    return name, arguments, result, text


def written(arguments):
    texts = []
    for name, kind, default in arguments:
        text = name + (f": {kind}" if kind else "")
        texts.append(text + (f" = {default}" if default is not None else ""))
    return ", ".join(texts)


def stub(name, arguments, result, text, indent="", overload=False, remark=""):
    head = indent + PLACED.format(name=name, arguments=written(arguments), result=result) + remark
    body = quoted(text, indent + "    ") + "\n" if text.strip() else ""
    return (indent + "@overload\n" if overload else "") + f"{head}\n{body}{indent}    ...\n"


def required(arguments, name, kind):
    """The same arguments, one of them of another type and without a default."""
    return [(n, kind if n == name else k, None if n == name else default) for n, k, default in arguments]


def with_type(arguments, name, kind):
    return [(n, kind if n == name else k, default) for n, k, default in arguments]


def function_stub(owner, function, indent=""):
    name, arguments, result, text = signature(owner, function)
    if name != "render":
        remark = NO_VIEWS if owner == "Layers." and name in ("keys", "values", "items") else ""
        return stub(name, arguments, result, text, indent, remark=remark)
    one = with_type(arguments, "frames", "None")
    sequence = required(required(arguments, "frames", "str"), "output", "Path")
    return (stub(name, one, result, text, indent, overload=True)
            + stub(name, sequence, FRAME_NUMBERS, "A sequence, into files.", indent, overload=True))


def class_stub(cls):
    name_of_class = cls.__name__
    base = BASES.get(name_of_class)
    lines = [f"class {name_of_class}({base}):" if base else f"class {name_of_class}:", quoted(cls.__doc__, "    "), ""]
    for name, member in sorted(vars(cls).items()):
        if isinstance(member, property):
            lines.append(f"    @property\n    def {name}(self) -> {PROPERTY_TYPES[name]}:")
            lines.append(quoted(member.__doc__, "        ") + "\n        ...")
            if member.fset:
                lines.append(f"    @{name}.setter\n    def {name}(self, value: Mapping[str, Attribute]) -> None: ...")
        elif callable(member) and (not name.startswith("_") or name in SPECIAL_METHODS):
            lines.append(function_stub(name_of_class + ".", member, "    "))
    return "\n".join(lines) + "\n"


def parameter_of(p):
    """A filter's parameter as a keyword argument."""
    name = p["name"].replace("-", "_")
    name += "_" if keyword.iskeyword(name) else ""
    kind = "Literal[{}]".format(", ".join(map(repr, p["choices"]))) if "choices" in p else "float"
    default = p["default"]
    if kind == "float" and isinstance(default, str):
        kind = "str"
    # Floats are stored in single precision, which has seven digits.
    return name, kind, repr(float(f"{default:.7g}") if isinstance(default, float) else default)


def denoise_stubs(brume):
    """One signature for each filter, with its parameters, one for the recommended filter, for sequences and files."""
    name, arguments, result, text = signature("", brume.denoise)
    common = [a for a in arguments if not a[0].startswith("**")]
    in_memory = with_type(common, "output", "None")
    stubs = []
    for entry in [None] + brume.filters():
        if entry is None:
            own = with_type(in_memory, "filter", "None")
        else:
            own = required(in_memory, "filter", f"Literal[{entry['name']!r}]")
            own += [parameter_of(p) for p in entry["parameters"]] + [("preset", "str", "...")]
        summary = "With the best filter that the frame's layers allow." if entry is None else entry["summary"]
        stubs.append(stub(name, own, result, summary, overload=True))
    # A name that is not known before it runs. Without parameters, or misspelt ones would be taken for those of any filter.
    stubs.append(stub(name, in_memory, result, text, overload=True))
    lists = with_type(with_type(with_type(arguments, "output", "None"), "layers", "list[Any] | tuple[Any, ...]"),
                      "guides", "list[Any] | tuple[Any, ...] | None")
    lists = with_type(lists, "second_frame", "None")
    stubs.append(stub(name, lists, "list[Layers]", "A sequence in memory.", overload=True))
    files = required(with_type(with_type(arguments, "layers", "Path"), "guides", "Path | None"), "output", "Path")
    files = with_type(files, "second_frame", "Path | None")
    stubs.append(stub(name, files, FRAME_NUMBERS + " | None", "From file to file.", overload=True))
    return "\n".join(stubs)


def stubs(brume):
    parts = [HEAD.format(summary=inspect.getdoc(brume).split("\n")[0], error=brume.InputError.__doc__)]
    for name in brume.__all__:
        thing = getattr(brume, name)
        if isinstance(thing, type) and name != "InputError":
            parts.append(class_stub(thing))
    for name in brume.__all__:
        thing = getattr(brume, name)
        if name == "denoise":
            parts.append(denoise_stubs(brume))
        elif not isinstance(thing, type):
            parts.append(function_stub("", thing))
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
        f"Summary: {inspect.getdoc(brume).split(chr(10))[0]}\nRequires-Python: >=3.11\nRequires-Dist: numpy\n"
    )
    (info / "top_level.txt").write_text("brume\n")


main()
