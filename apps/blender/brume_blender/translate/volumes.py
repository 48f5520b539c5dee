"""Volume objects: VDB files and what their shaders make of the grids."""

import os
import re

import bpy
import numpy as np

from . import lattices, vdb_header
from .files import GRIDS
from .nodes import output_of, tree_of
from .notes import CannotTranslate, LeftOut
from .toml_text import Table
from .volume_parts import glows, media, merged, set_medium
from .volume_shaders import VolumeShader

# Until then Cycles put a voxel's value into the middle of its far corner's cell (measured with 3.4).
HALF_VOXEL_BEFORE = (5, 0, 0)
COLOUR_TYPES = ("vec3s", "vec3d", "vec3i")


class GridFile:
    """A VDB file, and how it lies in the world."""

    virtual = False  # grids that are in no file until they are baked

    def __init__(self, path, grids, colours=(), index_offset=0.0, velocity=None, corners=(), factor=1.0, least=0.0):
        """@param velocity  (grid, world units of the file per frame for one unit of it), or None
        @param corners  of the boxes around its grids of numbers, in the file's space
        @param factor  on all that its shader computes
        @param least  value up to which Cycles takes voxels as empty"""
        self.path, self.grids, self.colours = path, grids, colours
        self.index_offset, self.velocity = index_offset, velocity
        self.corners, self.factor = corners, factor
        self.constants = {}  # colours by name that are the same everywhere
        self.derived = {}  # (grid, function of its values) by the name of an attribute that is no grid
        self.least = least
        self._baked = {}  # path by the name of a baked grid

    def stored(self, grid):
        """A grid's name in its file."""
        return grid

    def same_file(self, a, b):
        """Whether two grids are in one file."""
        return self._baked.get(a) == self._baked.get(b)

    def lattice(self, grid):
        """@throws NoLattice"""
        return lattices.read(self.path, grid, self.index_offset)

    def state(self):
        """What tells one state of the grids from another."""
        return self.path, os.stat(self.path).st_mtime_ns, self.index_offset

    def to_copy(self, colours):
        """(path, names) of the grids that a file of baked ones has to have, too."""
        return self.path, sorted({*colours, *([self.velocity[0]] if self.velocity is not None else [])})

    def stored_matrix(self, matrix, k):
        """Of a file whose voxels lie so in the object's space, k for each of the grids'."""
        return matrix

    def add_baked(self, path, grids, k, master):
        self._baked.update(dict.fromkeys(grids, path))

    def table(self, matrices, grid):
        """@param matrices  (as the shutter opens, as it closes), the second None where nothing moves"""
        table = Table("[[volumes]]").set(file=self._baked.get(grid, self.path), grid=grid, object_to_world=matrices[0])
        if matrices[1] is not None:
            table.set(object_to_world_end=matrices[1])
        if self.index_offset:
            table.set(index_offset=[self.index_offset] * 3)
        if self.velocity is not None:
            table.set(velocity_grid=self.velocity[0], velocity_scale=self.velocity[1])
        return table


def volume_shader_of(materials):
    """What the volume shader among materials is: a plug; None: there is none."""
    for material in materials:
        if material is not None:
            shader = output_of(tree_of(material), "Volume")
            if shader is not None:
                return shader
    return None


def path_of(volume, frame):
    """Of the file that a Volume's data shows in a frame. @throws LeftOut"""
    if not volume.filepath:
        raise LeftOut("it has no file")
    path = os.path.abspath(bpy.path.abspath(volume.filepath, library=volume.library))
    number = re.search(r"(\d+)(\.[^./]*)?$", path)
    if not volume.is_sequence or number is None:
        return path
    shown = _frame_of_sequence(volume, frame - volume.frame_start + 1)
    return f"{path[: number.start()]}{shown:0{len(number[1])}}{number[2] or ''}"


def _frame_of_sequence(volume, frame):
    """The number of a sequence's file, as Blender has it. @param frame  from its start, counted from 1"""
    count, mode = volume.frame_duration, volume.sequence_mode
    if count == 0 or (mode == "CLIP" and not 1 <= frame <= count):
        raise LeftOut("no file of its sequence is for this frame")
    if mode == "EXTEND":
        frame = min(max(frame, 1), count)
    elif mode == "REPEAT":
        frame = (frame - 1) % count + 1
    elif mode == "PING_PONG":
        frame = (frame - 1) % max(2 * count - 2, 1) + 1
        frame = 2 * count - frame if frame > count else frame
    return frame + volume.frame_offset


def factor_of(volume, matrix):
    """By which Cycles thins a volume that is scaled, so that it stays as dense to look through."""
    if volume.render.space != "OBJECT":
        return 1.0
    return 1 / max(np.linalg.norm(np.array(matrix.to_3x3()) @ np.full(3, 3**-0.5)), 1e-9)


def _saved(thing, folder):
    """A file of grids that Blender computes: by modifiers, or nodes. @throws LeftOut"""
    if len(thing.data.grids) == 0:
        raise LeftOut("it has no file" if not thing.modifiers else "its modifiers make no grid")
    key = (GRIDS, thing.data.as_pointer(), thing.name_full)
    if key not in folder.written:
        path = folder.new(".vdb", thing.name)
        if not thing.data.grids.save(filepath=path):
            raise LeftOut(f"Blender cannot write its grids: {thing.data.grids.error_message}")
        folder.written[key] = path
    return folder.written[key]


def file_of(thing, factor, shutter, scene, frame, folder, shown):
    """The GridFile of a Volume object; one that cannot be read has no grids: None.
    @param factor  on all that its shader computes
    @param shown  switch of the modifiers that are evaluated   @throws LeftOut, CannotTranslate"""
    volume = thing.data
    if not volume.filepath or any(getattr(modifier, shown) for modifier in thing.modifiers):
        path = _saved(thing, folder)
    else:
        path = path_of(volume, frame)
    if not os.path.isfile(path):
        if volume.is_sequence:  # which Blender shows as nothing
            raise LeftOut(f"its file {path} is not there")
        raise CannotTranslate(f"{thing.name}: its file {path} is not there")
    try:
        grids, boxes = vdb_header.grids(path), vdb_header.boxes(path)
    except (vdb_header.NotVdb, OSError):
        return GridFile(path, None)
    names = [name for name, kind in grids.items() if kind not in COLOUR_TYPES]
    colours = [name for name, kind in grids.items() if kind in COLOUR_TYPES]
    velocity = None
    moving = next((name for name in (volume.velocity_grid, "velocity") if name in colours), None)
    if shutter is not None and moving is not None and volume.velocity_scale != 0:
        # Cycles takes a velocity by frames as the way over the whole shutter.
        by_second = volume.velocity_unit == "SECOND"
        frames = scene.render.fps / scene.render.fps_base if by_second else shutter[1] - shutter[0]
        velocity = (moving, volume.velocity_scale / frames)
    offset = 0.5 if bpy.app.version < HALF_VOXEL_BEFORE else 0.0
    corners = [corner for name in names for corner in boxes.get(name, [])]
    return GridFile(path, names, colours, offset, velocity, corners, factor, getattr(volume.render, "clipping", 0.0))


def volume_tables(thing, materials, file, place, bake, matrices, notes):
    """A table for each medium that a volume's shader makes of its file. @param bake  function of a shader and its file (baking.bake)   @throws LeftOut: none of them could be"""
    if file.grids is None:
        return [file.table(matrices, "")]  # the program says what is wrong with it
    shader_plug = volume_shader_of(materials)
    if shader_plug is None and any(material is not None for material in materials):
        raise LeftOut("its material has no volume shader")
    if shader_plug is None and "density" not in file.grids:
        raise LeftOut(f"it has no material, and its file no grid 'density'; it has: {', '.join(file.grids) or 'none'}")
    shader = VolumeShader(shader_plug, thing.name, file, place, notes)
    return tables_of(thing.name, shader, bake(shader, file), file, matrices, notes)


def tables_of(name, shader, baked, file, matrices, notes):
    """@param baked  baking.Baked: what the shader is made of   @throws LeftOut"""
    tables, hosts = [], []  # hosts: (grid, table) that emit nothing yet
    parts = merged(media(shader, baked.closures, file.grids, name, notes) + baked.parts)
    for part in parts:
        tables.append(file.table(matrices, part.grid))
        hosts.append((part.grid, tables[-1]))
        set_medium(tables[-1], part)
        if part.colour_grid and not part.sigma_a.any():
            notes.say(name, f"what its colours '{part.colour_grid}' do not scatter is absorbed")
    for glow in [*glows(shader, baked.closures, name, notes), *baked.glows]:
        if not glow.grid:
            _glow_everywhere(glow, parts, file, name, notes)
        host = next((h for h in hosts if file.same_file(h[0], glow.grid)), None)
        if host is None:
            host = (glow.grid, file.table(matrices, glow.grid).set(sigma_t=0))
            tables.append(host[1])
        else:
            hosts.remove(host)
        glow.set(host[1], file.stored(glow.grid))
    if not tables:
        notes.say(name, "its volume shader neither scatters, absorbs nor emits")
    return tables


def _glow_everywhere(glow, parts, file, name, notes):
    """Has the same emission wherever a grid is above 0. @throws LeftOut"""
    if not file.grids:
        raise LeftOut("its file has no grid of numbers")
    glow.grid = parts[0].grid if parts else "density" if "density" in file.grids else file.grids[0]
    glow.ramp = [[0, 0, 0, 0], [1e-6, *glow.ramp], [1, *glow.ramp]]
    notes.say(name, f"what it emits everywhere it emits where the grid '{glow.grid}' is above 0")
