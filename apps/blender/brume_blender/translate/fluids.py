"""Smoke and fire of fluid domains, from the OpenVDB files of their caches."""

import os

import bpy
import numpy as np
from mathutils import Matrix, Vector

from . import lattices
from .nodes import output_of, tree_of
from .notes import LeftOut
from .toml_text import Table
from .vdb_header import NotVdb, voxel_sizes
from .volumes import volume_tables

# Names in the files by Blender's names of attributes: of the base grids, and of those with noise.
BASE = {"density": "density", "flame": "flame", "heat": "temperature"}
NOISE = {"density": "density_noise", "flame": "flame_noise"}


def domain_of(thing, shown):
    """Settings of an object's gas domain; None: it is none."""
    for modifier in thing.modifiers:
        if modifier.type == "FLUID" and getattr(modifier, shown) and modifier.fluid_type == "DOMAIN":
            settings = modifier.domain_settings
            return settings if settings.domain_type == "GAS" else None
    return None


class FluidCache:
    """The files of a domain's cache at one frame, as volume_tables reads a VDB file."""

    colours, factor, least, virtual = (), 1.0, 0.0, False

    def __init__(self, thing, settings, frame, shutter, scene, notes):
        if settings.cache_data_format != "OPENVDB":
            raise LeftOut(f"the cache of the fluid domain is no OpenVDB but {settings.cache_data_format}")
        self._name, self._notes = thing.name, notes
        self._frame = min(max(frame, settings.cache_frame_start), settings.cache_frame_end) + settings.cache_frame_offset
        folder = bpy.path.abspath(settings.cache_directory)
        points = np.array([v.co[:] for v in thing.data.vertices])
        self._lo, self._size = points.min(0), np.ptp(points, axis=0)
        self._cells = np.array(settings.domain_resolution, float)
        self._velocity = set()  # the files that have one
        self._files = {}  # path, name and voxel size in the file, cells of each grid
        self._add(os.path.join(folder, "data", f"fluid_data_{self._frame:04d}.vdb"), BASE, 1)
        if settings.use_noise:
            self._add(os.path.join(folder, "noise", f"fluid_noise_{self._frame:04d}.vdb"), NOISE, settings.noise_scale)
        self.grids = list(self._files)
        self.constants = self._colour(settings)  # which the files hold multiplied by the density
        self._heat = (settings.flame_ignition, settings.flame_max_temp)
        self.derived = {"temperature": ("flame", _temperature(settings.flame_ignition, settings.flame_max_temp))}
        self._velocity_scale = None
        if shutter is not None:
            self._velocity_scale = settings.velocity_scale * scene.render.fps_base / scene.render.fps

    def _add(self, path, grids, finer):
        if not os.path.isfile(path):
            raise LeftOut(f"its cache has no file {path}")
        try:
            sizes = voxel_sizes(path)
        except (NotVdb, OSError) as error:
            raise LeftOut(f"its cache's file {path} {error}") from error
        for grid, stored in grids.items():
            if stored in sizes:
                self._files[grid] = (path, stored, sizes[stored], self._cells * finer)
        if "velocity" in sizes:
            self._velocity.add(path)

    def _colour(self, settings):
        """The colour of the smoke: one for all of it."""
        premultiplied = np.array(settings.color_grid, float).reshape(-1, 4)
        if not premultiplied[:, 3].sum() > 0:
            return {}
        colour = premultiplied[:, :3].sum(0) / premultiplied[:, 3].sum()
        dense = premultiplied[premultiplied[:, 3] > 0.01]
        if len(dense) and np.ptp(dense[:, :3] / dense[:, 3:], axis=0).max() > 0.02:
            self._notes.say(self._name, "the colours of its smoke are taken as their mean")
        return {"color": colour}

    def stored(self, grid):
        return self._files[grid][1]

    def same_file(self, a, b):
        return self._files[a][0] == self._files[b][0]

    def lattice(self, grid):
        """@throws NoLattice"""
        if grid in self.derived:  # voxel by voxel, as Blender has it
            base, function = self.derived[grid]
            return self.lattice(base).mapped(function)
        path, name, _, cells = self._files[grid]
        stored = lattices.read(path, name, 0.5)
        matrix = np.diag([*(self._size / cells), 1.0])
        matrix[:3, 3] = self._lo
        return stored.placed(matrix)

    def state(self):
        files = [(path, os.stat(path).st_mtime_ns) for path, *_ in self._files.values()]
        return files, self._heat, self._lo.tolist(), self._size.tolist()

    def to_copy(self, colours):
        path = next(iter(self._velocity), None)
        return path, ["velocity"] if path is not None and self._velocity_scale is not None else []

    def stored_matrix(self, matrix, k):
        return np.diag([*[self._voxel() / k] * 3, 1.0])

    def _voxel(self):
        return min(voxel for _, _, voxel, _ in self._files.values())

    def add_baked(self, path, grids, k, master):
        for grid in grids:
            cells = np.round(self._size / np.diag(master.matrix)[:3]) * k
            self._files[grid] = (path, grid, self._voxel() / k, cells)
        if self.to_copy(())[1]:
            self._velocity.add(path)

    def table(self, matrices, grid):
        path, name, voxel, cells = self._files[grid]
        # The value of cell i is that at its middle; the domain's mesh is the box of all cells.
        cell = self._size / cells
        placement = Matrix.Translation(Vector(self._lo)) @ Matrix.Diagonal((*(cell / voxel), 1.0))
        placement = placement @ Matrix.Translation(Vector([0.5 * voxel] * 3))
        opens, closes = (m and m @ placement for m in matrices)
        table = Table("[[volumes]]").set(file=path, grid=name, object_to_world=opens)
        if closes is not None:
            table.set(object_to_world_end=closes)
        self._set_velocity(table, path, cell, voxel)
        return table

    def _set_velocity(self, table, path, cell, voxel):
        if self._velocity_scale is None:
            return
        if path not in self._velocity:
            self._notes.say(self._name, "the noise of the fluid is in another file than its velocity: it stands still")
        else:
            if np.ptp(cell) > 0.01 * cell.max():
                self._notes.say(self._name, "its velocity is that of the fluid, which Cycles stretches as the domain's object is")
            table.set(velocity_grid="velocity", velocity_scale=self._velocity_scale * voxel / cell.mean())


def _temperature(ignition, hottest):
    """What Blender gives as the attribute of a domain."""
    return lambda flame: np.where(np.asarray(flame) > 0.01, ignition + np.asarray(flame) * (hottest - ignition), 0.0)


def domain_tables(thing, materials, settings, frame, place, bake, matrices, shutter, scene, notes):
    """@throws LeftOut"""
    cache = FluidCache(thing, settings, frame, shutter, scene, notes)
    if any(m is not None and output_of(tree_of(m), "Surface") is not None for m in materials):
        notes.say(thing.name, "the surface of the fluid's domain is left out")
    return volume_tables(thing, materials, cache, place, bake, matrices, notes)
