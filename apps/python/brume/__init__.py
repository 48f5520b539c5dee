"""Renders OpenVDB smoke and clouds without bias, and removes Monte Carlo noise from media passes.

    import brume
    frame = brume.render("cloud.toml", spp=16, clean=True)
    brume.write("cloud.exr", frame)
    clean = brume.denoise(brume.read("noisy.exr"), "nl_means", search_radius=7)
    print(brume.metrics(clean, brume.read("reference.exr"))["lab_rms"])

Errors are brume.InputError. What the command line tells as a note goes to the logger "brume" as a warning, what
--quiet would silence as information. docs/python.md says more.
"""

import functools as _functools
import inspect as _inspect

from . import _brume
from ._brume import InputError, Layers, Scene, __commit__, __version__

# What the module declares is what the package offers.
__all__ = sorted(_name for _name in vars(_brume) if not _name.startswith("_"))


def _signature(function):
    """What the first line of a compiled function's help says."""
    head = function.__doc__.partition("\n")[0].replace("brume._brume.", "")
    model = {}
    exec(f"from __future__ import annotations\ndef {head}: ...", model)
    return _inspect.signature(model[function.__name__])


def _of_method(signature):
    first, *rest = signature.parameters.values()
    return signature.replace(parameters=[first.replace(name="self", annotation=first.empty), *rest])


def _in_python(function, signature, name):
    """A compiled function as one of Python, which has a signature and can be pickled by its name."""

    @_functools.wraps(function)
    def call(*arguments, **keywords):
        return function(*arguments, **keywords)

    call.__signature__, call.__module__, call.__qualname__ = signature, "brume", name
    return call


for _name in __all__:
    _value = getattr(_brume, _name)
    if not isinstance(_value, type):
        globals()[_name] = _in_python(_value, _signature(_value), _name)
for _class in (Layers, Scene):
    for _name, _value in list(vars(_class).items()):
        if callable(_value) and not _name.startswith("_"):
            setattr(_class, _name, _in_python(_value, _of_method(_signature(_value)), f"{_class.__name__}.{_name}"))
    _init = _of_method(_signature(_class.__init__))
    _class.__signature__ = _init.replace(parameters=list(_init.parameters.values())[1:], return_annotation=_class)
    _class.__module__ = "brume"
InputError.__signature__ = _inspect.Signature([_inspect.Parameter("args", _inspect.Parameter.VAR_POSITIONAL)])
