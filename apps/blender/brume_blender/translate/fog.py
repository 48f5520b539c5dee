"""Fog inside of meshes: brume fills boxes and balls with it."""

import numpy as np
from mathutils import Matrix, Vector

from .colour import blackbody
from .notes import LeftOut
from .toml_text import Table
from .volume_parts import joined, set_coefficients
from .volume_shaders import SIGMA, VolumeShader


def fog_table(thing, shader_plug, points, place, matrices, notes):
    """A homogeneous volume. @param points  the mesh's vertices, (N, 3), in its own space   @throws LeftOut"""
    shader = VolumeShader(shader_plug, thing.name, None, place, notes)
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
        raise LeftOut("its volume shader is 0 without grids, which a mesh has not")
    shape, placement = _shape(points, thing.name, notes)
    opens, closes = (m and m @ placement for m in matrices)
    table = Table("[[volumes]]").set(shape=shape, lo=[-1, -1, -1], hi=[1, 1, 1], object_to_world=opens)
    if closes is not None:
        table.set(object_to_world_end=closes)
    set_coefficients(table, sums["scatter"], sums["absorption"], _at_most_two(lobes, thing.name, notes))
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


def _shape(points, name, notes):
    """box or sphere, and where its cube from -1 to 1 lies in the mesh's space. @throws LeftOut"""
    lo, hi = points.min(0), points.max(0)
    half, middle = 0.5 * (hi - lo), 0.5 * (lo + hi)
    if not np.all(half > 0):
        raise LeftOut("its mesh is flat")
    unit = (points - middle) / half
    placement = Matrix.Translation(Vector(middle)) @ Matrix.Diagonal((*half, 1.0))
    if len(points) >= 42 and np.all(np.abs(np.linalg.norm(unit, axis=1) - 1) < 0.02):
        return "sphere", placement
    if len(points) != 8 or not np.all(np.abs(np.abs(unit) - 1) < 1e-4):
        notes.say(name, "its fog fills the box around the mesh")
    return "box", placement
