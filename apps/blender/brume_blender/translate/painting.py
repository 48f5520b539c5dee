"""Pictures that nodes compute for surfaces and worlds, some texels at a time: F12's check may end them in between, and a viewport has
them computed in a thread of their own."""

import contextlib
import os

import numpy as np

from .beside import Cancelled, Failure, Pending
from .pictures import repair, write_exr

STEP = 1 << 13  # texels at once


class Painting:
    """@param size  (width, height)   @param computed  function of the first texel and the one after the last, row by row from the
    top: linear RGB, (N, 3); it knows nothing of Blender   @param is_light  whether it may exceed 1: it is stored over its peak then"""

    def __init__(self, size, computed, is_light=False):
        self._size, self._computed, self._is_light = size, computed, is_light

    def write(self, path, check):
        """@param check  called several times a second; may throw
        @return (what the stored values have to be multiplied by, how many were NaN or infinite)"""
        width, height = self._size
        picture = np.empty((width * height, 3), np.float32)
        for first in range(0, len(picture), STEP):
            check()
            last = min(first + STEP, len(picture))
            picture[first:last] = self._computed(first, last)
        repaired = repair(picture)
        np.clip(picture, 0, None if self._is_light else 1, out=picture)
        peak = 1.0
        if self._is_light:
            peak = float(max(picture.max(), 1e-9))
            picture /= peak
        write_exr(path, picture.reshape(height, width, 3), check)
        return peak, repaired


def mean_of(values):
    """What is taken for a picture while it is being painted. @param values  some of its own, (N, 3)"""
    values = np.array(values, np.float32)
    repair(values)
    return values.mean(0, dtype=float)


class AtOnce:
    """Paints where it is asked to."""

    def __init__(self, folder, check):
        self._folder, self._check = folder, check

    def painted(self, key, names, made):
        """(path, peak, repaired), as of Painting.write. @param key  of what is in it   @param names  parts of the file's name
        @param made  function that gives the Painting"""
        painting = made()
        path = self._folder.new(".exr", *names)
        return path, *painting.write(path, self._check)


class Beside:
    """Has it painted in the thread of a viewport's bakes."""

    def __init__(self, folder, bakes):
        self._folder, self._bakes = folder, bakes

    def painted(self, key, names, made):
        """As AtOnce.painted. @throws Pending: it is not there yet"""
        part, *about = self._bakes.result(("picture", *key), lambda: _Job(names[-1], self._folder, made())).given()
        path = self._folder.new(".exr", *names)
        os.replace(part, path)
        return path, *about


class _Job:
    """As beside.Job."""

    def __init__(self, name, folder, painting):
        self.name, self.cancelled = name, False
        self._path, self._painting = folder.part(".exr"), painting

    def run(self):
        """@throws Cancelled"""
        return Failure.of(self._written)

    def _written(self):
        return _Written(self._path, *self._painting.write(self._path, self._check))

    def _check(self):
        if self.cancelled:
            raise Cancelled


class _Written:
    elsewhere = lasts = False

    def __init__(self, path, *about):
        self._path, self._about = path, about

    def is_there(self):
        return os.path.exists(self._path)

    def given(self):
        return self._path, *self._about

    def drop(self):
        with contextlib.suppress(FileNotFoundError):  # it has its place in the scene
            os.remove(self._path)
