"""The folder that meshes and pictures of a translation are written into."""

import os
import re


class Folder:
    """@param path  of the folder   @param scene_folder  at which the scene file's names start; the same unless given"""

    def __init__(self, path, scene_folder=None):
        self._path = os.path.abspath(path)
        self._start = os.path.abspath(scene_folder or path)
        self._taken = set()
        self.files = []  # paths, in the order in which they were asked for

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

    def remove(self):
        """The files that were written."""
        for path in self.files:
            if os.path.exists(path):
                os.remove(path)

    def named(self, path):
        """What the scene file calls a file of this folder; others by their whole path."""
        return os.path.relpath(path, self._start).replace(os.sep, "/") if path in self.files else path
