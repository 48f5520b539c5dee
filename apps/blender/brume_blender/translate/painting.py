"""Pictures that nodes compute for surfaces and worlds, some texels at a time: F12's check may end them in between, and a viewport has
them computed in a thread of their own."""

import os

import numpy as np

from .beside import Cancelled, Failure, Pending
from .pictures import write_exr

STEP = 1 << 13  # texels at once


class Painting:
    """@param size  (width, height)   @param computed  function of the first texel and the one after the last, row by row from the
    top: linear RGB, (N, 3); it knows nothing of Blender   @param is_light  whether it may exceed 1: it is stored over its peak then"""

    def __init__(self, size, computed, is_light=False):
        self._size, self._computed, self._is_light = size, computed, is_light

    def write(self, path, check):
        """@param check  called several times a second; may throw   @return what the stored values have to be multiplied by"""
        width, height = self._size
        picture = np.empty((width * height, 3), np.float32)
        for first in range(0, len(picture), STEP):
            check()
            last = min(first + STEP, len(picture))
            picture[first:last] = np.clip(self._computed(first, last), 0, None if self._is_light else 1)
        peak = 1.0
        if self._is_light:
            peak = float(max(picture.max(), 1e-9))
            picture /= peak
        write_exr(path, picture.reshape(height, width, 3), check)
        return peak


class AtOnce:
    """Paints where it is asked to."""

    def __init__(self, folder, check):
        self._folder, self._check = folder, check

    def painted(self, key, names, made):
        """(path, peak). @param key  of what is in it   @param names  parts of the file's name   @param made  function that gives
        the Painting"""
        painting = made()
        path = self._folder.new(".exr", *names)
        return path, painting.write(path, self._check)


class Beside:
    """Has it painted in the thread of a viewport's bakes."""

    def __init__(self, folder, bakes):
        self._folder, self._bakes = folder, bakes

    def painted(self, key, names, made):
        """As AtOnce.painted. @throws Pending: it is not there yet"""
        part, peak = self._bakes.result(("picture", *key), lambda: _Job(names[-1], self._folder, made())).given()
        path = self._folder.new(".exr", *names)
        os.replace(part, path)
        return path, peak


class _Job:
    """As beside.Job."""

    def __init__(self, name, folder, painting):
        self.name, self.cancelled = name, False
        self._path, self._painting = folder.part(".exr"), painting

    def run(self):
        """@throws Cancelled"""
        return Failure.of(self._written)

    def _written(self):
        return _Written(self._path, self._painting.write(self._path, self._check))

    def _check(self):
        if self.cancelled:
            raise Cancelled


class _Written:
    elsewhere = False

    def __init__(self, path, peak):
        self._path, self._peak = path, peak

    def is_there(self):
        return os.path.exists(self._path)

    def given(self):
        return self._path, self._peak
