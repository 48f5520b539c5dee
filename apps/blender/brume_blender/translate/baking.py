"""What a volume shader's nodes compute, baked into grids: where a coefficient depends on textures, coordinates or several grids,
or bends so fast that it has to be computed between voxels, too, as Cycles does.

The field is evaluated on a lattice of `k` points for each voxel of the finest grid that it depends on, with the smallest k
between whose points straight lines keep it, as judged at random points.
"""

import hashlib
import os
from dataclasses import dataclass, field

import numpy as np

from . import lattices
from .lattices import NoLattice
from .volume_parts import Glow, Part

BLOCK = 8  # voxels: of OpenVDB's leaves, in whose whole blocks Cycles evaluates a shader
FINER = (0.25, 0.5, 1, 2, 3, 4, 6, 8)  # below 1 where there are too many voxels
# What the field may be off between the lattice's points, relative: its mean, its mean absolute difference; and from where on
# it is said.
ENOUGH, TOLD = (0.004, 0.05), (0.01, 0.1)
_FILLED = {}  # blocks that hold something, by a digest of field and blocks
PROBES = 8192
BATCH = 1 << 16  # points at once
MILLIONS = 16  # of voxels, unless the scene says otherwise
VIEWPORT_MILLIONS = 0.5  # at most in a viewport, whose picture waits for them


@dataclass
class Baked:
    """What a volume is made of: what was baked, and the closures that need no bake."""

    closures: list
    parts: list = field(default_factory=list)
    glows: list = field(default_factory=list)
    files: list = field(default_factory=list)  # arguments of a source's add_baked

    def tell(self, source):
        """Tells the source of the grids where those are that were baked of them."""
        for file in self.files:
            source.add_baked(*file)


def bake(shader, source, folder, most_voxels, notes, check=lambda: None):
    """@param source  of grids: lattice(name), add_baked(path, grids, k, master), least: values up to which are nothing
    @param check   called several times a second; may throw"""
    baked = _baked(shader, source, folder, most_voxels, notes, check)
    baked.tell(source)
    return baked


def _baked(shader, source, folder, most_voxels, notes, check):
    try:
        chosen = [closure for closure in shader.closures if _needs_bake(shader, closure, source, check)]
        if not chosen:
            return Baked(shader.closures)
        return _Bake(shader, chosen, source, folder, most_voxels, notes, check).run()
    except NoLattice as reason:
        notes.say(shader.name, f"what its nodes compute cannot be baked: {reason}")
        return Baked(shader.closures)


def nothing_to_bake(shader, source):
    """Whether that is so, as known without a look at the grids."""
    return all(_bends(shader, closure, source) is False for closure in shader.closures)


def _needs_bake(shader, closure, source, check):
    bends = _bends(shader, closure, source)
    if bends is not None:
        return bends
    field_ = _Field(shader, [closure], source, check)
    return len(field_.blocks) > 0 and not field_.keeps(1)


def _bends(shader, closure, source):
    """Whether a closure is more than a curve of one grid; None: the grid tells whether the curve bends within its voxels."""
    if source.virtual:
        return True
    used = shader.used(closure)
    if not used:  # as wide as the other closures' grids; alone it is nothing that Cycles renders
        return any(map(shader.used, shader.closures)) and (shader.bends_space(closure) or bool(shader.evaluate(closure, {}).any()))
    if len(used) > 1 or shader.bends_space(closure) or used[0] in source.colours or shader.derived(closure):
        return True
    if shader.evaluate(closure, {used[0]: np.zeros(1)}).any():
        return True
    if closure.kind in ("emission", "black_body") or shader.is_linear(closure, used[0]):
        return False  # curves of emission act between voxels in brume, too
    return False if lattices.openvdb is None else None


class _Field:
    """Coefficients of closures at points of the space in which the finest of their grids has its voxels."""

    def __init__(self, shader, closures, source, check):
        self._shader, self.closures, self._check = shader, closures, check
        # All of the shader's: where any of them is, Cycles evaluates it.
        names = sorted({name for closure in shader.closures for name in (*shader.used(closure), *shader.derived(closure))})
        self._lattices = {name: source.lattice(name) for name in names}
        ordered = sorted(self._lattices.values(), key=lambda l: abs(np.linalg.det(l.matrix[:3, :3])))
        self.master = ordered[0]
        self.bias = self.lost = 0.0
        self._probe(lattices.blocks_around(ordered, source.least, BLOCK))
        key = hashlib.sha1(repr((source.state(), shader.signature, len(self.blocks))).encode() + self.digest()).digest()
        if len(self.blocks):
            filled = _FILLED.get(key)  # of which other threads know, too
            if filled is None:
                if len(_FILLED) >= 64:
                    _FILLED.clear()
                filled = _FILLED[key] = self._filled()
            self._probe(filled)

    def _probe(self, blocks):
        """Keeps to some blocks, and looks at random points in them."""
        self.blocks = blocks
        random = np.random.default_rng(1)
        if len(blocks):
            self._probes = blocks[random.integers(len(blocks), size=PROBES)] + random.random((PROBES, 3)) * BLOCK
            self.probed = self.at(self._probes)

    def digest(self):
        return b"".join(np.float32(values).tobytes() for values in self.probed) if len(self.blocks) else b""

    def _filled(self):
        """The blocks in which a voxel, or one that borders on them, is above 0; of many, every other or fourth voxel is judged."""
        stride = 1 if len(self.blocks) < 1 << 13 else 2 if len(self.blocks) < 1 << 16 else 4
        inner = _cube(range(-1, BLOCK + stride, stride))
        step, kept = max(BATCH // len(inner), 1), []
        for first in range(0, len(self.blocks), step):
            lowest = self.blocks[first : first + step]
            values = self.at((lowest[:, None, :] + inner).reshape(-1, 3) + self.master.offset)
            kept.append(np.any([v.reshape(len(lowest), -1).any(1) for v in values], axis=0))
        return self.blocks[np.concatenate(kept)]

    def at(self, index):
        """(N, 3) for each closure, (N,) of a black body. @param index  (N, 3)"""
        points = self.master.points_of(index)
        return self._computed(points, {name: self._read(lattice, index, points) for name, lattice in self._lattices.items()})

    def in_blocks(self, lowest, k):
        """As at(), at k points for each voxel of blocks. @param lowest  (B, 3)"""
        index = ((lowest * k)[:, None, :] + _cube(range(int(BLOCK * k)))).reshape(-1, 3)
        index = (index + self.master.offset) / k
        points, values = self.master.points_of(index), {}
        for name, lattice in self._lattices.items():
            same = np.array_equal(lattice.matrix, self.master.matrix)
            values[name] = lattice.in_blocks(lowest, BLOCK, k) if same else lattice.at(points)
        return self._computed(points, values)

    def _read(self, lattice, index, points):
        return lattice.at_index(index) if np.array_equal(lattice.matrix, self.master.matrix) else lattice.at(points)

    def _computed(self, points, values):
        self._check()
        return [np.maximum(self._shader.evaluate(c, values, points), 0) for c in self.closures]

    def keeps(self, k):
        """Whether lines between k points for each voxel keep the field; bias and lost tell by how much they do not."""
        x = self._probes * k - self.master.offset
        low = np.floor(x)
        f = x - low
        between = 0
        for corner in range(8):
            step = np.array([corner >> axis & 1 for axis in range(3)])
            share = np.prod(np.where(step, f, 1 - f), axis=1)
            values = self.at((low + step + self.master.offset) / k)
            between = [b + share * v.T for b, v in zip(between or [0] * len(values), values)]
        self.bias = self.lost = 0.0
        for closure, line, true in zip(self.closures, between, self.probed):
            line, true = _power(closure, line), _power(closure, true.T)
            size = max(true.sum(), 1e-30)
            self.bias = max(self.bias, abs(line.sum() - true.sum()) / size)
            self.lost = max(self.lost, np.abs(line - true).sum() / size)
        return self.within(ENOUGH)

    def within(self, limits):
        return self.bias <= limits[0] and self.lost <= limits[1]


def _cube(steps):
    """(n^3, 3)"""
    return np.stack(np.meshgrid(*[list(steps)] * 3, indexing="ij"), -1).reshape(-1, 3)


def _power(closure, values):
    return values**4 if closure.kind == "black_body" else values


@dataclass
class _Scalar:
    """A field of one number: `channel` of what a closure computes, over `unit`."""

    closure: int
    channel: int  # None: of a number
    unit: float
    probed: np.ndarray

    def of(self, values):
        own = values[self.closure]
        return (own if self.channel is None else own[..., self.channel]) / self.unit


class _Bake:
    def __init__(self, shader, closures, source, folder, most_voxels, notes, check):
        self._shader, self._source, self._folder, self._notes = shader, source, folder, notes
        self._most = most_voxels
        self._field = _Field(shader, closures, source, check)
        self._left = [closure for closure in shader.closures if closure not in closures]
        self._scalars = []

    def run(self):
        made = Baked(self._left)
        if len(self._field.blocks) == 0:
            return made  # grids without voxels
        k = self._resolution()
        uses = [use for i in range(len(self._field.closures)) for use in self._split(i)]
        if not self._scalars:
            return made
        peaks = self._file(k, made)
        for closure, number, colour in uses:
            grid = self._name(number)
            if closure.kind == "scatter":
                made.parts.append(Part(grid, None, colour, lobes=[(closure.g, colour)], colour_grid=closure.colour_grid))
            elif closure.kind == "absorption":
                made.parts.append(Part(grid, None, sigma_a=colour))
            elif closure.kind == "black_body":
                made.glows.append(Glow(grid, kelvin=float(colour), intensity=closure.intensity))
            else:
                top = 1.01 * peaks[number]
                made.glows.append(Glow(grid, [[0, 0, 0, 0], [top, *(top * colour)]]))
        return made

    def _resolution(self):
        finest = (self._most / (len(self._field.blocks) * BLOCK**3)) ** (1 / 3)
        choices = [k for k in FINER if 1 <= k <= finest] or [max([k for k in FINER if k <= finest], default=FINER[0])]
        for k in choices:
            if self._field.keeps(k):
                return k
        if self._field.within(TOLD):
            return k
        voxel = np.linalg.norm(self._field.master.matrix[:3, 0]) / k
        why = f"as fine as {self._most / 1e6:.4g} million of them are (Performance > Baked Voxels)" if k < FINER[-1] else "the finest"
        between = f"{100 * self._field.lost:.2g} % of it lies between them"
        self._notes.say(self._shader.name, f"what its nodes compute is baked in voxels of {voxel:.3g}, {why}; {between}")
        return k

    def _split(self, i):
        """(closure, number of a scalar field, colour) whose products are a closure's coefficient."""
        closure, values = self._field.closures[i], self._field.probed[i]
        if not values.any():
            return []
        if values.ndim == 1:
            return [(closure, self._scalar(i, None, 1.0, values), 1.0)]
        channel = np.argmax(values.max(0))
        peak = values[:, channel]
        ratio = values[peak > 0] / peak[peak > 0, None]
        unit = peak.max()
        if np.all(np.ptp(ratio, axis=0) <= 1e-5) and not values[peak <= 0].any():
            return [(closure, self._scalar(i, channel, unit, peak / unit), unit * ratio[0])]
        uses = []
        for c in range(3):
            unit = values[:, c].max()
            if unit > 0:
                uses.append((closure, self._scalar(i, c, unit, values[:, c] / unit), unit * np.eye(3)[c]))
        return uses

    def _scalar(self, closure, channel, unit, probed):
        for number, other in enumerate(self._scalars):
            if (other.channel is None) == (channel is None) and np.allclose(other.probed, probed, rtol=1e-5, atol=1e-7):
                return number
        self._scalars.append(_Scalar(closure, channel, unit, probed))
        return len(self._scalars) - 1

    def _name(self, number):
        return f"baked_{number}"

    def _file(self, k, made):
        """Writes the grids, or finds them as they were written before. @param made  Baked   @return the largest value of each"""
        copied = self._source.to_copy({c.colour_grid for c in self._field.closures if c.colour_grid})
        key = hashlib.sha1(
            repr((self._source.state(), self._shader.signature, k, copied, len(self._field.blocks))).encode()
            + self._field.digest()
        ).hexdigest()
        path = self._folder.bake(self._shader.name, key)
        names = [self._name(number) for number in range(len(self._scalars))]
        if not os.path.exists(path):
            matrix = self._field.master.matrix.copy()
            matrix[:3, :3] /= k
            grids = dict(zip(names, self._computed(k)))
            blocks = (self._field.blocks * k).astype(int)
            lattices.write(path, grids, self._source.stored_matrix(matrix, k), blocks, copied)
        made.files.append((self._folder.named(path), names, k, self._field.master))
        return [lattices.peak(path, name) for name in names]

    def _computed(self, k):
        """Cubes of (blocks, n, n, n) for each scalar field."""
        n, blocks = int(BLOCK * k), self._field.blocks
        cubes = np.zeros((len(self._scalars), len(blocks), n**3), np.float32)
        step = max(BATCH // n**3, 1)
        for first in range(0, len(blocks), step):
            lowest = blocks[first : first + step]
            values = self._field.in_blocks(lowest, k)
            for cube, scalar in zip(cubes, self._scalars):
                cube[first : first + step] = scalar.of(values).reshape(len(lowest), -1)
        return cubes.reshape(len(self._scalars), len(blocks), n, n, n)

