"""What decides the result of a function, as text: for the cache of brume.evaluate."""

import dis
import functools
import hashlib
import io
import pathlib
import pickle
import sys
import sysconfig
import types


def fingerprint(function):
    """A text that changes when the function may give something else.

    Made from its `cache_key`, where it has that attribute. Otherwise from its bytecode, constants and defaults, the values
    that it closes over, and what it names of its module: functions and classes by their own code, other values by their
    pickle, modules by their files. What is installed counts by name and version. Raises ValueError for a value that
    cannot be pickled.
    """
    key = getattr(function, "cache_key", None)
    if key is not None:
        return f"key {key!r}"
    parts = []
    _Walk(parts, _top(function)).value("it", function)
    return "code " + _hash("\n".join(parts).encode("utf-8", "surrogateescape"))


def _hash(content):
    return hashlib.sha256(content).hexdigest()


def _top(thing):
    """The package or module that a function or class is of."""
    return (getattr(thing, "__module__", None) or type(thing).__module__ or "").partition(".")[0]


def _module_of(thing):
    return sys.modules.get(str(getattr(thing, "__module__", None)))


_INSTALLED = [pathlib.Path(sysconfig.get_path(which)).resolve() for which in ("stdlib", "platstdlib", "purelib", "platlib")]


def _source(module):
    """The file of a module that somebody works on; None for one that is installed, built in or of no file."""
    file = getattr(module, "__file__", None)
    if file is None or module.__name__.partition(".")[0] == __package__:
        return None
    path = pathlib.Path(file).resolve()
    if {"site-packages", "dist-packages"} & set(path.parts) or any(path.is_relative_to(folder) for folder in _INSTALLED):
        return None
    return path if path.is_file() else None


class _Pickler(pickle.Pickler):
    """Looks into functions, classes and modules inside of a value, of which a pickle has the names alone."""

    def __init__(self, file, walk, name):
        super().__init__(file, 4)
        self.walk, self.name = walk, name

    def persistent_id(self, thing):
        if isinstance(thing, (types.ModuleType, functools._lru_cache_wrapper)) or (
            isinstance(thing, (types.FunctionType, type)) and self.walk.is_own(thing)
        ):
            self.walk.value(f"a part of {self.name}", thing)
            return thing.__name__
        return None


class _Walk:
    def __init__(self, parts, own):
        self.parts = parts
        self.own = own  # the package whose code is looked into
        self.seen = {}  # what was looked into, which also keeps it alive

    def is_own(self, thing):
        """Whether the code of a function or class is looked into: that of its package, and all that is not installed."""
        return _top(thing) == self.own or _source(_module_of(thing)) is not None

    def add(self, *words):
        self.parts.append(" ".join(map(str, words)))

    def value(self, name, value):
        """Adds what decides a value. name: as an error calls it."""
        if id(value) in self.seen:
            return self.add("again", list(self.seen).index(id(value)))
        if isinstance(value, types.ModuleType):
            return self.module(value)
        if isinstance(value, types.MethodType):
            self.value(name, value.__func__)
            return self.value(f"the object of {name}", value.__self__)
        if isinstance(value, functools._lru_cache_wrapper):
            return self.value(name, value.__wrapped__)
        if isinstance(value, functools.partial):
            for i, part in enumerate((value.func, *value.args)):
                self.value(f"argument {i} of {name}" if i else name, part)
            for key, part in sorted(value.keywords.items()):
                self.add("keyword", key)
                self.value(f"argument {key} of {name}", part)
            return None
        if isinstance(value, (types.FunctionType, type)):
            if not self.is_own(value):
                module = sys.modules.get(_top(value))
                return self.add("of", value.__module__, value.__qualname__, getattr(module, "__version__", ""))
            self.seen[id(value)] = value
            return self.function(value) if isinstance(value, types.FunctionType) else self.type(value)
        if isinstance(value, (set, frozenset)):
            return self.add("set", sorted(map(repr, value)))
        pickled = io.BytesIO()
        try:
            _Pickler(pickled, self, name).dump(value)
        except Exception as error:  # pickle raises what it meets
            raise ValueError(f"{name} is a {type(value).__name__}, which cannot be pickled ({error})") from None
        return self.add("value", _hash(pickled.getvalue()))

    def module(self, module):
        """By its file, and those of what it imports of its kind."""
        path = _source(module)
        self.add("module", module.__name__, getattr(module, "__version__", "") if path is None else _hash(path.read_bytes()))
        if path is None:
            return
        self.seen[id(module)] = module
        for key, member in sorted(vars(module).items()):
            if isinstance(member, (types.FunctionType, type)):
                member = _module_of(member)
            if isinstance(member, types.ModuleType) and _source(member) is not None and id(member) not in self.seen:
                self.add("imports", key)
                self.module(member)

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
        self.add("handlers", getattr(code, "co_exceptiontable", b"").hex())
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
