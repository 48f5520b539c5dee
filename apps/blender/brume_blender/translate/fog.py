"""Fog inside of meshes: a box or a ball of one density as such, everything else as a grid of the mesh's inside."""

import hashlib

import numpy as np
from mathutils import Matrix, Vector

from . import lattices
from .colour import blackbody
from .nodes import output_of, tree_of
from .notes import LeftOut
from .places import Place
from .toml_text import Table
from .volume_parts import joined, set_coefficients
from .volume_shaders import SIGMA, VolumeShader
from .volumes import GridFile, tables_of

INSIDE = "the mesh's inside"
VOXELS = 1 << 20  # of a mesh's box
DARK = 20  # optical depth through which nothing is seen
BAND = 3  # voxels around a surface in which its distance is known


def fog_tables(thing, shader_plug, geometry, place, bake, matrices, notes):
    """@param geometry  meshes.Geometry   @param bake  baking.bake, of a shader and its source   @throws LeftOut"""
    points, name = geometry.points, thing.name
    if geometry.closed and geometry.spanned() < 0:
        notes.say(name, "its faces point inwards, where Cycles shows no fog; brume does")
    shape, placement = _shape(points)
    shader = VolumeShader(shader_plug, name, None, place, notes)
    fits = shape is not None and not any(shader.bends_space(closure) for closure in shader.closures)
    source = MeshGrid(geometry, matrices[0]) if not fits and lattices.openvdb is not None and placement is not None else None
    if source is not None and source.has_inside():
        shader = VolumeShader(shader_plug, name, source, place, notes)
        for closure in shader.closures:
            closure.coefficient = _inside(closure)
        return tables_of(name, shader, bake(shader, source), source, matrices, notes)
    if not fits:
        notes.say(name, "its fog fills the box around the mesh" + (", which is not closed" if source is not None else ""))
    sums, lobes = _coefficients(shader)
    if placement is None:
        raise LeftOut("its mesh is flat")
    return [_homogeneous(name, sums, lobes, shape or "box", [m and m @ placement for m in matrices], notes)]


class MeshGrid(GridFile):
    """What is inside of a mesh, as a volume's grid: 1, and 0 outside."""

    virtual = True

    def __init__(self, geometry, matrix):
        super().__init__(None, [INSIDE])
        self._geometry, self._lattice = geometry, None
        scale = np.linalg.norm(np.array(matrix)[:3, :3], axis=0)
        size = np.ptp(geometry.points, axis=0) * scale
        self._voxel = max((size.prod() / VOXELS) ** (1 / 3), size.max() / 512) / scale

    def has_inside(self):
        """Whether the surface holds about the volume that its triangles span: it may have small holes."""
        spanned = abs(self._geometry.spanned()) / np.prod(self._voxel)
        return self.lattice(INSIDE).values.sum() > 0.8 * spanned > 0

    def lattice(self, grid):
        if self._lattice is None:
            self._lattice = self._sampled()
        return self._lattice

    def _sampled(self):
        index = (self._geometry.points / self._voxel).astype(np.float32)
        triangles = self._geometry.vertices.astype(np.uint32)
        level_set = lattices.openvdb.FloatGrid.createLevelSetFromPolygons(index, triangles=triangles, halfWidth=BAND)
        lo, hi = level_set.evalActiveVoxelBoundingBox()
        distance = np.empty([b - a + 1 for a, b in zip(lo, hi)], np.float32)
        level_set.copyToArray(distance, ijk=lo)
        return lattices.Lattice(np.clip(0.5 - distance, 0, 1), lo, np.diag([*self._voxel, 1.0]), 0.0)

    def state(self):
        return hashlib.sha1(self._geometry.points.tobytes() + self._geometry.vertices.tobytes()).hexdigest(), self._voxel.tolist()

    def to_copy(self, colours):
        return None, []


def world_fog_table(world, depsgraph, reach, notes):
    """The volume of a world, as a box so wide that nothing is seen through it; None: it has none. @throws LeftOut
    @param reach  from the origin to what lies farthest from it"""
    plug = output_of(tree_of(world), "Volume") if world is not None else None
    if plug is None:
        return None
    shader = VolumeShader(plug, world.name, None, Place(None, np.eye(4), depsgraph), notes)
    if any(shader.bends_space(closure) for closure in shader.closures):
        notes.say(world.name, "its volume varies; what it is at the origin is taken everywhere")
    sums, lobes = _coefficients(shader)
    sigma_t = sums["scatter"] + sums["absorption"]
    if not sigma_t.any():
        raise LeftOut("it emits without an end")
    half = reach + DARK / sigma_t[sigma_t > 0].min()
    return _homogeneous(world.name, sums, lobes, "box", (Matrix.Scale(half, 4), None), notes)


def _inside(closure):
    outside = closure.coefficient

    def coefficient(values, leaves):
        inside = np.asarray(leaves.value(INSIDE))
        return outside(values, leaves) * (inside if closure.kind == "black_body" else inside[..., None])

    return coefficient


def _coefficients(shader):
    """What closures of each kind add up to, and the lobes of its scatterings. @throws LeftOut: to nothing"""
    sums = {"scatter": np.zeros(3), "absorption": np.zeros(3), "emission": np.zeros(3)}
    lobes = []
    for closure in shader.closures:
        value = np.maximum(shader.evaluate(closure, {}), 0)[0]
        kind = closure.kind
        if kind == "black_body":
            kind, value = "emission", SIGMA * closure.intensity * value**4 * np.maximum(blackbody(value), 0)
        if kind == "scatter" and value.any():
            lobes.append((closure.g, value))
        sums[kind] = sums[kind] + value
    if not any(value.any() for value in sums.values()):
        raise LeftOut("its volume shader is 0 without grids, which it has not")
    return sums, lobes


def _homogeneous(name, sums, lobes, shape, matrices, notes):
    table = Table("[[volumes]]").set(shape=shape, lo=[-1, -1, -1], hi=[1, 1, 1], object_to_world=matrices[0])
    if matrices[1] is not None:
        table.set(object_to_world_end=matrices[1])
    set_coefficients(table, sums["scatter"], sums["absorption"], _at_most_two(lobes, name, notes))
    if sums["emission"].any():
        table.set(emission=sums["emission"])
    return table


def _at_most_two(lobes, name, notes):
    together = joined(lobes, [])
    if together is not None:
        return together
    mean = sum(g * sigma.sum() for g, sigma in lobes) / sum(sigma.sum() for _, sigma in lobes)
    notes.say(name, f"its scatterings are of several anisotropies; their mean, {mean:.4g}, is taken")
    return [(mean, sum(sigma for _, sigma in lobes))]


def _shape(points):
    """box, sphere, or None: another; and where its cube from -1 to 1 lies in the mesh's space, None of a flat one."""
    lo, hi = points.min(0), points.max(0)
    half, middle = 0.5 * (hi - lo), 0.5 * (lo + hi)
    if not np.all(half > 0):
        return "box", None
    unit = (points - middle) / half
    placement = Matrix.Translation(Vector(middle)) @ Matrix.Diagonal((*half, 1.0))
    if len(points) >= 42 and np.all(np.abs(np.linalg.norm(unit, axis=1) - 1) < 0.02):
        return "sphere", placement
    return "box" if len(points) == 8 and np.all(np.abs(np.abs(unit) - 1) < 1e-4) else None, placement
