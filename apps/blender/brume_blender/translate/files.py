"""The folder that meshes and pictures of a translation are written into, or of several, one after another."""

import contextlib
import os
import re

from .pictures import Pictures

GRIDS = "grids"  # begins keys of `written` of files of grids that Blender has computed
MOST_BAKED = 4 << 30  # bytes of baked grids that are kept; the oldest go first


class Folder:
    """@param path  of the folder   @param scene_folder  at which the scene file's names start; the same unless given
    @param bakes  folder that baked grids are kept in for later renders; the same unless given"""

    def __init__(self, path, scene_folder=None, bakes=None):
        self._path = os.path.abspath(path)
        self._start = os.path.abspath(scene_folder or path)
        self._bakes = bakes
        self._taken, self._parts = set(), 0
        self.files = []  # paths, in the order in which they were asked for
        # What later translations need not do again.
        self.geometries = {}  # by what they are of: (meshes.Geometry or None, names of objects and meshes)
        self.written = {}  # paths, or textures that have one, by what is in them
        self.pictures = Pictures()

    def new(self, suffix, *parts):
        """Path of a new file, named by parts of a name, unlike all before."""
        stem = re.sub(r"[^A-Za-z0-9_-]+", "_", "_".join(parts)).strip("_")[:80] or "unnamed"
        name, number = stem + suffix, 1
        while name.lower() in self._taken:
            number += 1
            name = f"{stem}_{number}{suffix}"
        self._taken.add(name.lower())
        self.files.append(os.path.join(self._path, name))
        return self.files[-1]

    def part(self, suffix):
        """Path of a file that is no part of the scene yet."""
        self._parts += 1
        return os.path.join(self._path, f"part_{self._parts}.part{suffix}")

    def bake(self, name, key):
        """Path of baked grids, which may be there already. @param key  of what they are baked from, a word"""
        if self._bakes is None:
            return self.new(".vdb", name, "baked", key[:8])
        os.makedirs(self._bakes, exist_ok=True)
        path = os.path.join(self._bakes, key + ".vdb")
        if os.path.exists(path):
            os.utime(path)
        self._forget_old_bakes()
        return path

    def _forget_old_bakes(self):
        sizes = []
        for entry in os.scandir(self._bakes):
            with contextlib.suppress(FileNotFoundError):  # another thread was quicker
                if entry.name.endswith(".vdb") and ".part." not in entry.name:
                    sizes.append((entry.stat().st_mtime, entry.stat().st_size, entry.path))
        total = 0
        for _, size, path in sorted(sizes, reverse=True):
            total += size
            if total > MOST_BAKED:
                with contextlib.suppress(FileNotFoundError):
                    os.remove(path)

    def forget_geometry(self, names):
        """What was read of changed objects or meshes, and what was written of it."""
        gone = {key for key, (_, own) in self.geometries.items() if not own.isdisjoint(names)}
        for key in gone:
            del self.geometries[key]
        self.written = {key: value for key, value in self.written.items() if gone.isdisjoint(key) and names.isdisjoint(key)}

    def forget_frame(self):
        """What is another one at another frame, meshes apart, which Blender tells of."""
        self.pictures.forget_moving()
        kept = lambda value: not value.moves if hasattr(value, "moves") else value.endswith(".ply")  # noqa: E731
        self.written = {key: value for key, value in self.written.items() if kept(value)}

    def forget_pictures(self):
        """Images that have changed, and what was painted of them."""
        self.pictures.forget()
        self.written = {key: value for key, value in self.written.items() if not hasattr(value, "moves")}

    def remove_unused(self, text):
        """Files that a scene does not name, but for grids that others are baked of."""
        kept = {path for key, path in self.written.items() if key[0] == GRIDS}
        for path in [path for path in self.files if os.path.basename(path) not in text and path not in kept]:
            self.files.remove(path)
            if os.path.exists(path):
                os.remove(path)
        there = set(self.files)
        self.written = {key: value for key, value in self.written.items() if getattr(value, "path", value) in there}
        self.geometries = {key: value for key, value in self.geometries.items() if any(key in other for other in self.written)}

    def remove(self):
        """The files that were written."""
        for path in self.files:
            if os.path.exists(path):
                os.remove(path)

    def named(self, path):
        """What the scene file calls a file of this folder; others by their whole path."""
        return os.path.relpath(path, self._start).replace(os.sep, "/") if path in self.files else path
