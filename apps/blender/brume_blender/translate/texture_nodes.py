"""Blender's procedural texture nodes, as node_values evaluates nodes."""

import bpy
import numpy as np

from . import procedural

PCG_SINCE = (5, 0, 0)  # of Blender, the hash of Voronoi textures


class Unsupported(Exception):
    """A setting of a node of which there is no counterpart."""


class _Inputs:
    """A texture node's inputs at as many points as the longest of them has.

    @param values  node_values.Values   @param plug  an output of the node"""

    def __init__(self, values, plug):
        self._values, self._plug = values, plug
        self._read = {}
        names = {p.socket.name for p in plug.inputs()}
        self._read["Vector"] = self._vector() if "Vector" in names else np.zeros(3)
        for name in names - {"Vector"}:
            socket = plug.input(name)
            if socket.socket.type == "VALUE":
                self._read[name] = np.asarray(values.number(socket), float)
        sizes = [len(v) for name, v in self._read.items() if v.ndim > (name == "Vector")]
        self.one = not sizes
        self._count = max(sizes, default=1)

    def _vector(self):
        plug = self._plug.input("Vector")
        return np.asarray(self._values.colour(plug) if plug.resolve().socket.is_output else self._values.generated(self._plug), float)

    def number(self, name, default=0.0):
        return self._read.get(name, np.asarray(default))

    def vector(self, scaled=True):
        """(N, 3)"""
        scale = self.number("Scale", 1.0) if scaled else np.asarray(1.0)
        return np.broadcast_to(self._read["Vector"] * scale[..., None], (self._count, 3))

    def points(self, dimensions, scaled=True):
        """(N, dimensions). @param dimensions  as Blender writes them, '1D' to '4D'"""
        w = np.broadcast_to(self.number("W") * (self.number("Scale", 1.0) if scaled else 1.0), self._count)[:, None]
        vector = self.vector(scaled)
        return {"1D": w, "2D": vector[:, :2], "3D": vector, "4D": np.concatenate([vector, w], -1)}[dimensions]

    def result(self, value):
        return value[0] if self.one else value


def _needs(condition, what):
    if not condition:
        raise Unsupported(what)


def _noise(values, plug):
    node, i = plug.node, _Inputs(values, plug)
    _needs(getattr(node, "noise_type", "FBM") == "FBM", "Noise Texture other than fBM")
    roughness = i.number("Roughness") if hasattr(node, "normalize") else np.clip(i.number("Roughness"), 0, 1)  # Blender 4.0
    return i.result(procedural.noise(
        i.points(node.noise_dimensions), i.number("Detail"), roughness, i.number("Distortion"),
        plug.socket.type == "RGBA", i.number("Lacunarity", 2.0), getattr(node, "normalize", True),
    ))  # fmt: skip


def _musgrave(values, plug):
    node, i = plug.node, _Inputs(values, plug)
    return i.result(procedural.musgrave(
        node.musgrave_type, i.points(node.musgrave_dimensions), i.number("Detail"), i.number("Dimension"), i.number("Lacunarity"),
        i.number("Offset"), i.number("Gain"),
    ))  # fmt: skip


def _voronoi(values, plug):
    node, i = plug.node, _Inputs(values, plug)
    _needs(not getattr(node, "normalize", False) and not np.any(i.number("Detail")), "Voronoi Texture with detail")
    dimensions = node.voronoi_dimensions
    distance, colour, position = procedural.voronoi(
        node.feature, node.distance, i.points(dimensions), i.number("Smoothness"), i.number("Exponent"), i.number("Randomness"),
        procedural.hashed if bpy.app.version < PCG_SINCE else procedural.pcg_hashed,
    )  # fmt: skip
    scale = i.number("Scale", 1.0)
    position = position / np.where(scale != 0, scale, 1)[..., None]
    if plug.socket.name == "W":
        return i.result(position[:, -1])
    if plug.socket.name == "Position":
        place = np.zeros((len(position), 3))
        columns = {"1D": 0, "2D": 2, "3D": 3, "4D": 3}[dimensions]
        place[:, :columns] = position[:, :columns]
        return i.result(place)
    return i.result(colour if plug.socket.type == "RGBA" else distance)


def _white_noise(values, plug):
    i = _Inputs(values, plug)
    p = i.points(plug.node.noise_dimensions, scaled=False)
    return i.result(procedural.hashed(p, 3) if plug.socket.type == "RGBA" else procedural.hashed(p, 1)[:, 0])


def _coloured(plug, result, value):
    return result(np.repeat(value[:, None], 3, -1) if plug.socket.type == "RGBA" else value)


def _wave(values, plug):
    node, i = plug.node, _Inputs(values, plug)
    direction = node.bands_direction if node.wave_type == "BANDS" else node.rings_direction
    return _coloured(plug, i.result, procedural.wave(
        node.wave_type, direction, node.wave_profile, i.vector(), i.number("Distortion"), i.number("Detail"),
        i.number("Detail Scale"), i.number("Detail Roughness"), i.number("Phase Offset"),
    ))  # fmt: skip


def _gradient(values, plug):
    i = _Inputs(values, plug)
    return _coloured(plug, i.result, procedural.gradient(plug.node.gradient_type, i.vector()))


def _magic(values, plug):
    i = _Inputs(values, plug)
    colour = procedural.magic(i.vector(), i.number("Distortion"), plug.node.turbulence_depth)
    return i.result(colour if plug.socket.type == "RGBA" else colour.mean(-1))


def _checker(values, plug):
    i = _Inputs(values, plug)
    factor = procedural.checker(i.vector())
    if plug.socket.type != "RGBA":
        return i.result(factor)
    first, second = (np.asarray(values.colour(plug.input(name))) for name in ("Color1", "Color2"))
    return i.result(np.where(factor[:, None] > 0, first, second))


TEXTURES = {
    "TEX_NOISE": _noise,
    "TEX_MUSGRAVE": _musgrave,
    "TEX_VORONOI": _voronoi,
    "TEX_WHITE_NOISE": _white_noise,
    "TEX_WAVE": _wave,
    "TEX_GRADIENT": _gradient,
    "TEX_MAGIC": _magic,
    "TEX_CHECKER": _checker,
}
