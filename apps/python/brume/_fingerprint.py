"""What decides the result of a function, as text: for the cache of brume.evaluate."""

import dis
import functools
import hashlib
import pickle
import sys
import types


def fingerprint(function):
    """A text that changes when the function may give something else.

    Made from its `cache_key`, where it has that attribute. Otherwise from its bytecode, constants and defaults, the values
    that it closes over, and what it names of its module: functions and classes by their own code, other values by their
    pickle, modules by name and version. Functions of other packages count by name and version. Raises ValueError for a
    value that cannot be pickled.
    """
    key = getattr(function, "cache_key", None)
    if key is not None:
        return f"key {key!r}"
    parts = []
    _Walk(parts, _top(function)).value("it", function)
    return "code " + hashlib.sha256("\n".join(parts).encode("utf-8", "surrogateescape")).hexdigest()


def _top(thing):
    """The package or module that a function or class is of."""
    return (getattr(thing, "__module__", None) or type(thing).__module__ or "").partition(".")[0]


class _Walk:
    def __init__(self, parts, own):
        self.parts = parts
        self.own = own  # the package whose code is looked into
        self.seen = {}  # what was looked into, which also keeps it alive

    def add(self, *words):
        self.parts.append(" ".join(map(str, words)))

    def value(self, name, value):
        """Adds what decides a value. name: as an error calls it."""
        if id(value) in self.seen:
            return self.add("again", list(self.seen).index(id(value)))
        if isinstance(value, types.ModuleType):
            return self.add("module", value.__name__, getattr(value, "__version__", ""))
        if isinstance(value, types.MethodType):
            self.value(name, value.__func__)
            return self.value(f"the object of {name}", value.__self__)
        if isinstance(value, functools.partial):
            for i, part in enumerate((value.func, *value.args)):
                self.value(f"argument {i} of {name}" if i else name, part)
            for key, part in sorted(value.keywords.items()):
                self.add("keyword", key)
                self.value(f"argument {key} of {name}", part)
            return None
        if isinstance(value, (types.FunctionType, type)):
            if _top(value) != self.own:
                module = sys.modules.get(_top(value))
                return self.add("of", value.__module__, value.__qualname__, getattr(module, "__version__", ""))
            self.seen[id(value)] = value
            return self.function(value) if isinstance(value, types.FunctionType) else self.type(value)
        if isinstance(value, (set, frozenset)):
            return self.add("set", sorted(map(repr, value)))
        if type(value).__module__ != "builtins" and _top(type(value)) == self.own:
            self.value(f"the class of {name}", type(value))
        try:
            self.add("value", hashlib.sha256(pickle.dumps(value, 4)).hexdigest())
        except Exception as error:  # pickle raises what it meets
            raise ValueError(f"{name} is a {type(value).__name__}, which cannot be pickled ({error})") from None
        return None

    def type(self, cls):
        self.add("class", cls.__qualname__)
        for base in cls.__bases__:
            self.value(f"a base of {cls.__name__}", base)
        for key, member in sorted(vars(cls).items()):
            if isinstance(member, (staticmethod, classmethod)):
                member = member.__func__
            if key.startswith("__") and not isinstance(member, types.FunctionType):
                continue  # Python's own notes on the class
            self.add("member", key)
            if isinstance(member, property):
                for part in (member.fget, member.fset):
                    self.value(f"{cls.__name__}.{key}", part)
            elif not isinstance(member, (types.MemberDescriptorType, types.GetSetDescriptorType)):
                self.value(f"{cls.__name__}.{key}", member)

    def function(self, function):
        self.code(function.__code__)
        self.value("its defaults", function.__defaults__)
        for key, part in sorted((function.__kwdefaults__ or {}).items()):
            self.add("default", key)
            self.value(f"the default of {key}", part)
        for key, cell in zip(function.__code__.co_freevars, function.__closure__ or ()):
            self.add("closes over", key)
            try:
                self.value(f"'{key}', which it closes over,", cell.cell_contents)
            except ValueError as error:
                if "cannot be pickled" in str(error):
                    raise
                self.add("empty")  # not assigned yet
        for key in sorted(_names(function.__code__)):
            if key in function.__globals__:
                self.add("names", key)
                self.value(f"'{key}', which it names,", function.__globals__[key])

    def code(self, code):
        self.add("bytecode", code.co_code.hex(), code.co_argcount, code.co_kwonlyargcount, code.co_flags)
        self.add("names", code.co_names, code.co_varnames, code.co_freevars)
        for constant in code.co_consts:
            if isinstance(constant, types.CodeType):
                self.code(constant)
            elif isinstance(constant, frozenset):
                self.add("constant", sorted(map(repr, constant)))
            else:
                self.add("constant", repr(constant))


def _names(code):
    """What a function and those inside it look up in their module."""
    names = {i.argval for i in dis.get_instructions(code) if i.opname in ("LOAD_GLOBAL", "LOAD_NAME")}
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            names |= _names(constant)
    return names
