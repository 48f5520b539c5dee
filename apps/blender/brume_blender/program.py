"""Where the brume program is, and whether it is one that this add-on can talk to. Knows nothing of Blender."""

import functools
import json
import os
import re
import shutil
import stat
import subprocess

OLDEST = (0, 1, 0)  # version of the program that has all that is asked of it

HERE = os.path.dirname(os.path.abspath(__file__))
BUNDLED = os.path.join(HERE, "bin", "brume")
BUNDLED_READER = os.path.join(HERE, "bin", "brume-vdb-reader")  # that it starts
POINTER = os.path.join(HERE, "program_path.txt")  # written by ./run blender: the program that it built
VARIABLE = "BRUME_PROGRAM"


class NoProgram(Exception):
    """Why there is none to run."""


def find(preferred=""):
    """The path of the program: as the preferences say, as the environment's BRUME_PROGRAM says, in the add-on, where
    the add-on was built, or on PATH. What is said and is not there is an error. @throws NoProgram"""
    for said, path in (("the add-on's preferences name", preferred), (f"{VARIABLE} names", os.environ.get(VARIABLE, ""))):
        if path:
            path = os.path.abspath(path)
            if os.path.isfile(path) and not os.access(path, os.X_OK):
                raise NoProgram(f"{said} {path}, which may not be executed: make it executable (chmod +x)")
            if not _runs(path):
                raise NoProgram(f"{said} {path}, which is no program")
            return _checked(path)
    for path in (_bundled(), _pointed_at(), shutil.which("brume")):
        if path and _runs(path):
            return _checked(path)
    raise NoProgram("the program brume was not found on PATH; say where it is: Edit > Preferences > Add-ons > brume")


def _runs(path):
    return os.path.isfile(path) and os.access(path, os.X_OK)


def _bundled():
    """The program in the add-on's folder. Blender unpacks files without their modes: they are made executable here.
    @throws NoProgram"""
    for path in (BUNDLED, BUNDLED_READER):
        if os.path.isfile(path) and not os.access(path, os.X_OK):
            try:
                os.chmod(path, stat.S_IMODE(os.stat(path).st_mode) | 0o111)
            except OSError as error:
                raise NoProgram(f"{path} is not executable, and cannot be made so: {error.strerror}") from None
    return BUNDLED


def _pointed_at():
    try:
        with open(POINTER, encoding="utf-8") as file:
            return file.read().strip()
    except OSError:
        return ""


def _checked(path):
    version = version_of(path, os.stat(path).st_mtime_ns)
    if version < OLDEST:
        names = [".".join(map(str, v)) for v in (version, OLDEST)]
        raise NoProgram(f"{path} is brume {names[0]}; this add-on needs {names[1]} or newer")
    return path


@functools.lru_cache(maxsize=8)
def version_of(path, _written):
    """@throws NoProgram: it is another program, or does not start"""
    try:
        told = subprocess.run([path, "--version"], stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise NoProgram(f"{path} cannot be started: {error}") from None
    found = re.match(r"brume (\d+)\.(\d+)\.(\d+)", told.stdout)
    if not found:
        why = told.stderr.strip() or f"it calls itself '{told.stdout.strip()}'"
        raise NoProgram(f"{path} is not brume: {why}")
    return tuple(map(int, found.groups()))


@functools.lru_cache(maxsize=4)
def filters_of(path):
    """Names of its filters, the best first."""
    told = subprocess.run([path, "filters", "--json"], stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60)
    return [found["name"] for found in json.loads(told.stdout)["filters"]]
