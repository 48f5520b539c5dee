"""Grids of numbers and colours as dense arrays, read and written by the OpenVDB that Blender brings for Python."""

import functools
import os
import threading

import numpy as np

try:
    import openvdb
except ImportError:
    try:
        import pyopenvdb as openvdb  # its name before Blender 4.4
    except ImportError:
        openvdb = None

LARGEST = 1 << 27  # values of a dense array


class NoLattice(Exception):
    """Why a grid cannot be had as an array."""


class Lattice:
    """Values at the points lo + (i, j, k) + offset of a space whose matrix leads into an object's.

    @param values  (nx, ny, nz), or (nx, ny, nz, 3) of colours   @param matrix  4 x 4, for columns"""

    def __init__(self, values, lo, matrix, offset):
        self._padded = np.pad(values, [(1, 1)] * 3 + [(0, 0)] * (values.ndim - 3))
        self.values = self._padded[1:-1, 1:-1, 1:-1]
        self.lo, self.matrix, self.offset = np.asarray(lo), np.asarray(matrix, float), offset

    def index_of(self, points):
        """Of points in the object's space, (N, 3)."""
        inverse = np.linalg.inv(self.matrix)
        return points @ inverse[:3, :3].T + inverse[:3, 3]

    def points_of(self, index):
        return index @ self.matrix[:3, :3].T + self.matrix[:3, 3]

    def at(self, points):
        """Linear between voxels and 0 beyond them: (N,), or (N, 3). @param points  in the object's space, (N, 3)"""
        return self.at_index(self.index_of(points))

    def at_index(self, index):
        size = np.array(self._padded.shape[:3])
        x = np.clip(index - (self.lo - 1 + self.offset), 0, size - 1.001)
        low = x.astype(np.int64)
        f = (x - low).astype(np.float32)
        steps = np.array([size[1] * size[2], size[2], 1])
        first, values = low @ steps, self._padded.reshape(-1, *self.values.shape[3:])
        corners = [values[first + (np.array([n >> 2 & 1, n >> 1 & 1, n & 1]) @ steps)] for n in range(8)]
        for axis in (2, 1, 0):
            share = f[:, axis, None] if self.values.ndim > 3 else f[:, axis]
            corners = [a + share * (b - a) for a, b in zip(corners[::2], corners[1::2])]
        return corners[0]

    def in_blocks(self, lowest, size, k):
        """At k points for each voxel of blocks, at (j + offset) / k: (B * (size * k)^3,), or of colours (.., 3).
        @param k  1/2 or 1/4, too
        @param lowest  voxels of the blocks, (B, 3)"""
        rows = np.arange(int(size * k))
        at = (rows + self.offset) / k - self.offset + 1  # in a block with a voxel more on each side
        low = np.floor(at).astype(int)
        share = np.zeros((len(rows), size + 2), np.float32)
        share[rows, low] = 1 - (at - low)
        share[rows, np.minimum(low + 1, size + 1)] += at - low
        places = lowest[:, None, :] + np.arange(-1, size + 1)[:, None] - (self.lo - 1)
        x, y, z = np.moveaxis(np.clip(places, 0, np.array(self._padded.shape[:3]) - 1), -1, 0)
        cubes = self._padded[x[:, :, None, None], y[:, None, :, None], z[:, None, None, :]]
        for axis in (1, 2, 3):
            cubes = np.moveaxis(np.tensordot(cubes, share, (axis, 1)), -1, axis)
        return cubes.reshape(-1, *self.values.shape[3:])

    def mapped(self, function):
        return Lattice(function(self.values), self.lo, self.matrix, self.offset)

    def placed(self, matrix):
        return Lattice(self.values, self.lo, matrix, self.offset)


def read(path, name, offset):
    """@throws NoLattice"""
    return _read(path, os.stat(path).st_mtime_ns, name, offset)


@functools.lru_cache(maxsize=6)
def _read(path, _written, name, offset):
    if openvdb is None:
        raise NoLattice("this Blender has no OpenVDB for Python")
    try:
        grid = openvdb.read(path, name)
    except Exception as error:  # of several types
        raise NoLattice(f"{path}: {error}") from error
    axes = [np.array(grid.transform.indexToWorld(unit)) for unit in ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))]
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = np.stack([axis - axes[0] for axis in axes[1:]], 1), axes[0]
    if grid.activeVoxelCount() == 0:
        lo, size = (0, 0, 0), (1, 1, 1)
    else:
        lo, hi = grid.evalActiveVoxelBoundingBox()
        size = [b - a + 1 for a, b in zip(lo, hi)]
    colours = isinstance(grid.background, tuple)
    if np.prod(size) * (3 if colours else 1) > LARGEST:
        raise NoLattice(f"the grid '{name}' of {' x '.join(map(str, size))} voxels is too large")
    values = np.zeros((*size, 3) if colours else size, np.float32)
    grid.copyToArray(values, ijk=tuple(lo))
    return Lattice(values, lo, matrix, offset)


def write(path, grids, matrix, blocks, copied):
    """A file of grids whose voxels are given block by block, and of grids copied from another.

    @param grids   {name: one cube of values for each block}   @param blocks  (B, 3) lowest voxels of the blocks
    @param matrix  object's space from voxels, 4 x 4   @param copied  (path, names) of the grids to copy"""
    made = []
    for name, cubes in grids.items():
        grid = openvdb.FloatGrid()
        grid.name = name
        grid["peak"] = float(max(cubes.max(), 0))
        grid.gridClass = openvdb.GridClass.FOG_VOLUME
        grid.transform = openvdb.createLinearTransform(np.asarray(matrix, float).T.tolist())
        for lo, cube in zip(blocks.tolist(), cubes):
            grid.copyFromArray(np.ascontiguousarray(cube, np.float32), ijk=tuple(lo))
        made.append(grid)
    made += [openvdb.read(copied[0], name) for name in copied[1]]
    part = f"{path}.{os.getpid()}.{threading.get_ident()}.part.vdb"
    openvdb.write(part, made)
    os.replace(part, path)


def peak(path, name):
    """The largest value of a grid that write() has written."""
    return openvdb.readGridMetadata(path, name)["peak"]


def blocks_around(lattices, least, block):
    """Lowest voxels of the blocks of the first lattice that hold a value above `least` of any, or border on one: (B, 3)."""
    found = [_blocks_of(lattices[0], least, block)]
    for lattice in lattices[1:]:
        blocks = _blocks_of(lattice, least, block)
        if not np.array_equal(lattice.matrix, lattices[0].matrix):
            ends = [lattices[0].index_of(lattice.points_of((blocks + end) * block)) / block for end in (0, 1)]
            low, high = np.floor(np.minimum(*ends) + 1e-6).astype(int), np.ceil(np.maximum(*ends) - 1e-6).astype(int)
            ranges = [np.stack(np.meshgrid(*map(np.arange, a, b), indexing="ij"), -1).reshape(-1, 3) for a, b in zip(low, high)]
            blocks = np.concatenate([np.zeros((0, 3), int), *ranges])
        found.append(blocks)
    return np.unique(np.concatenate(found), axis=0) * block


def _blocks_of(lattice, least, block):
    """Of a lattice's own: (B, 3), in blocks."""
    filled = (lattice.values if lattice.values.ndim == 3 else lattice.values.max(-1)) > least
    low = np.floor_divide(lattice.lo - 1, block)
    ends = [(l - b * block, -(l + n - b * block) % block) for l, n, b in zip(lattice.lo, filled.shape, low)]
    filled = np.pad(filled, [(before, after + block) for before, after in ends])
    for axis in range(3):
        filled = filled | np.roll(filled, 1, axis) | np.roll(filled, -1, axis)
    shape = [n // block for n in filled.shape]
    touched = filled.reshape(shape[0], block, shape[1], block, shape[2], block).any((1, 3, 5))
    return np.argwhere(touched) + low
