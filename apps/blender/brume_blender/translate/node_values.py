"""Values of shader nodes as arrays: what Blender's nodes compute, in NumPy, for many points at once.

`Values` evaluates a socket for as many points as its leaves have: what depends on the point (a volume's grid, a direction
of the sky, a texel) comes from the leaves; nodes without a counterpart here raise `UnknownNode`.
"""

import numpy as np

from . import node_maths
from .colour import blackbody, hsv_from_rgb, luminance, rgb_from_hsv
from .texture_nodes import TEXTURES, Unsupported

TABLE = 256  # entries of a ramp or curve, as Cycles has them


class UnknownNode(Exception):
    """A node of which there is no counterpart; its text names it."""


class Values:
    """@param leaves  function of a plug whose node depends on the point: an array of (N,) or (N, 3); None: it is no leaf.
    It may raise UnknownNode, and may have a method generated(), the texture coordinates of nodes that are given none.
    @param unknown  function of a plug without a counterpart and of that node's name, which gives the value to take; None:
    UnknownNode is raised"""

    def __init__(self, leaves=lambda plug: None, unknown=None):
        self._leaves, self._unknown, self._known = leaves, unknown, {}

    def number(self, plug):
        """A socket as an array of (N,), or a number where it is the same for all points."""
        return self._as(plug, 1)

    def colour(self, plug):
        """A socket as an array of (N, 3), or (3,)."""
        return self._as(plug, 3)

    def _as(self, plug, size):
        value, kind = self._value(plug)
        is_number = kind == "VALUE"
        if size == 3:
            return np.repeat(np.asarray(value)[..., None], 3, -1) if is_number else value
        if is_number:
            return value
        return luminance(value) if kind == "RGBA" else value.mean(-1)

    def _value(self, plug):
        """Value and kind: VALUE, RGBA or VECTOR."""
        source = plug.resolve()
        kind = "VALUE" if source.socket.type in ("INT", "BOOLEAN") else source.socket.type
        if not source.socket.is_output:
            default = getattr(source.socket, "default_value", 0.0)  # hidden ones have none
            return (np.array(default[:3]), kind) if hasattr(default, "__len__") else (float(default), kind)
        key = source.key()
        if key not in self._known:
            self._known[key] = self._computed(source)
        return self._known[key], kind

    def generated(self, plug):
        """Texture coordinates of a node that is given none. @throws UnknownNode"""
        if not hasattr(self._leaves, "generated"):
            raise UnknownNode(plug.node.bl_label)
        return self._leaves.generated()

    def _computed(self, plug):
        try:
            leaf = self._leaves(plug)
            if leaf is not None:
                return leaf
            compute = NODES.get(plug.node.type)
            if compute is None:
                raise UnknownNode(plug.node.bl_label or plug.node.bl_idname)
            return compute(self, plug)
        except (UnknownNode, Unsupported) as unknown:
            if self._unknown is None:
                raise UnknownNode(str(unknown)) from None
            return self._unknown(plug, str(unknown))


# Each takes the evaluator and the output's plug.


def _value(values, plug):
    return float(plug.node.outputs[0].default_value)


def _rgb(values, plug):
    return np.array(plug.node.outputs[0].default_value[:3])


def _math(values, plug):
    a = [values.number(p) for p in plug.inputs()] + [0.0, 0.0]
    result = node_maths.scalar(plug.node.operation, *a[:3])
    if result is None:
        raise UnknownNode(f"Math ({plug.node.operation})")
    return np.clip(result, 0, 1) if plug.node.use_clamp else result


def _vector_math(values, plug):
    vectors = [values.colour(p) for p in plug.inputs() if p.socket.type == "VECTOR"] + [np.zeros(3)] * 3
    scale = [values.number(p) for p in plug.inputs() if p.socket.type == "VALUE"] + [1.0]
    result = node_maths.vector(plug.node.operation, *vectors[:3], scale[0])
    if result is None:
        raise UnknownNode(f"Vector Math ({plug.node.operation})")
    return result


def _mix_rgb(values, plug):
    factor = np.clip(values.number(plug.input("Fac", "Factor")), 0, 1)
    return _blended(plug.node, factor, values.colour(plug.input("Color1")), values.colour(plug.input("Color2")), plug.node.use_clamp)


def _mix(values, plug):
    node = plug.node
    a, b = (plug.input(f"{letter}_{_MIX_KINDS[node.data_type]}") for letter in "AB")
    if node.data_type == "VECTOR" and node.factor_mode == "NON_UNIFORM":
        factor = values.colour(plug.input("Factor_Vector"))
    else:
        factor = values.number(plug.input("Factor_Float"))
    factor = np.clip(factor, 0, 1) if node.clamp_factor else factor
    if node.data_type == "RGBA":
        return _blended(node, factor, values.colour(a), values.colour(b), node.clamp_result)
    if node.data_type == "FLOAT":
        a, b = values.number(a), values.number(b)
        return a + (b - a) * factor
    a, b = values.colour(a), values.colour(b)
    return a + (b - a) * _column(factor)


_MIX_KINDS = {"FLOAT": "Float", "VECTOR": "Vector", "RGBA": "Color"}


def _column(number):
    number = np.asarray(number, float)
    return number if number.ndim and number.shape[-1:] == (3,) else number[..., None]


def _blended(node, factor, a, b, clamp):
    result = node_maths.blended(node.blend_type, _column(factor), a, b)
    if result is None:
        raise UnknownNode(f"Mix ({node.blend_type})")
    return np.clip(result, 0, 1) if clamp else result


def _looked_up(table, x):
    """Linear between entries that lie evenly on [0, 1], constant beyond."""
    at = np.clip(x, 0, 1) * (len(table) - 1)
    low = np.minimum(at.astype(int), len(table) - 2)
    return table[low] + (at - low)[..., None] * (table[low + 1] - table[low])


def ramp_table(ramp):
    """(TABLE, 4): a ramp's colours, evenly from 0 to 1."""
    if hasattr(ramp, "table"):  # frozen
        return ramp.table
    return np.array([ramp.evaluate(i / (TABLE - 1)) for i in range(TABLE)])


def _colour_ramp(values, plug):
    ramp = plug.node.color_ramp
    table = ramp_table(ramp)
    x = np.asarray(values.number(plug.input("Fac", "Factor")), float)
    if ramp.interpolation == "CONSTANT" and ramp.color_mode == "RGB":
        result = table[(np.clip(x, 0, 1) * (TABLE - 1)).astype(int)]
    else:
        result = _looked_up(table, x)
    return result[..., 3] if plug.socket.name == "Alpha" else result[..., :3]


def curve_table(mapping, curve):
    """Where a curve of a CurveMapping is known, and its values there."""
    if hasattr(curve, "table"):  # frozen
        return curve.table
    lo, hi = mapping.clip_min_x, mapping.clip_max_x
    if not mapping.use_clip:
        points = [p.location[0] for p in curve.points]
        lo, hi = min(lo, *points), max(hi, *points)
    xs = np.linspace(lo, hi, TABLE)
    return xs, np.array([mapping.evaluate(curve, v) for v in xs])


def _curve(mapping, curve, x):
    """Straight beyond its ends where the mapping says so."""
    xs, ys = curve_table(mapping, curve)
    lo, hi = xs[0], xs[-1]
    x = np.asarray(x, float)
    y = np.interp(x, xs, ys)
    if mapping.extend == "EXTRAPOLATED":
        y = np.where(x < lo, ys[0] + (x - lo) * (ys[1] - ys[0]) / (xs[1] - xs[0]), y)
        y = np.where(x > hi, ys[-1] + (x - hi) * (ys[-1] - ys[-2]) / (xs[-1] - xs[-2]), y)
    return y


def _faded(plug, values, before, after):
    factor = values.number(plug.input("Factor", "Fac"))
    factor = _column(factor) if np.ndim(before) and np.shape(before)[-1] == 3 else factor
    return before + (after - before) * factor


def _rgb_curves(values, plug):
    mapping = plug.node.mapping
    mapping.initialize()
    before = np.asarray(values.colour(plug.input("Color")))
    combined = mapping.curves[3]
    after = np.stack([_curve(mapping, mapping.curves[c], _curve(mapping, combined, before[..., c])) for c in range(3)], -1)
    return _faded(plug, values, before, after)


def _vector_curves(values, plug):
    mapping = plug.node.mapping
    mapping.initialize()
    before = np.asarray(values.colour(plug.input("Vector")))
    return _faded(plug, values, before, np.stack([_curve(mapping, mapping.curves[c], before[..., c]) for c in range(3)], -1))


def _float_curve(values, plug):
    mapping = plug.node.mapping
    mapping.initialize()
    before = values.number(plug.input("Value"))
    return _faded(plug, values, before, _curve(mapping, mapping.curves[0], before))


def _map_range(values, plug):
    node = plug.node
    vector = getattr(node, "data_type", "FLOAT") == "FLOAT_VECTOR"
    names = ("Vector", "From_Min_FLOAT3", "From_Max_FLOAT3", "To_Min_FLOAT3", "To_Max_FLOAT3") if vector else (
        "Value", "From Min", "From Max", "To Min", "To Max")
    read = values.colour if vector else values.number
    x, from_min, from_max, to_min, to_max = (read(plug.input(name)) for name in names)
    steps = None
    if node.interpolation_type == "STEPPED":
        steps = read(plug.input("Steps_FLOAT3" if vector else "Steps"))
    return node_maths.map_range(node.interpolation_type, x, from_min, from_max, to_min, to_max, steps, node.clamp)


def _clamp(values, plug):
    x, lo, hi = (values.number(plug.input(name)) for name in ("Value", "Min", "Max"))
    if plug.node.clamp_type == "RANGE":
        lo, hi = np.minimum(lo, hi), np.maximum(lo, hi)
    return np.minimum(np.maximum(x, lo), hi)


def _gamma(values, plug):
    colour, gamma = values.colour(plug.input("Color")), _column(values.number(plug.input("Gamma")))
    return np.where(colour > 0, np.maximum(colour, 0) ** gamma, colour)


def _bright_contrast(values, plug):
    contrast = _column(values.number(plug.input("Contrast")))
    offset = _column(values.number(plug.input("Bright", "Brightness"))) - contrast * 0.5
    return np.maximum(values.colour(plug.input("Color")) * (1 + contrast) + offset, 0)


def _hue_saturation(values, plug):
    colour = np.asarray(values.colour(plug.input("Color")), float)
    hue, saturation, value = (values.number(plug.input(name)) for name in ("Hue", "Saturation", "Value"))
    hsv = hsv_from_rgb(colour)
    hsv = np.stack(np.broadcast_arrays((hsv[..., 0] + hue + 0.5) % 1.0, np.clip(hsv[..., 1] * saturation, 0, 1), hsv[..., 2] * value), -1)
    return np.maximum(_faded(plug, values, colour, rgb_from_hsv(hsv)), 0)


def _invert(values, plug):
    colour = values.colour(plug.input("Color"))
    return _faded(plug, values, colour, 1 - colour)


def _grey(values, plug):
    return luminance(np.asarray(values.colour(plug.input("Color"))))


def _blackbody(values, plug):
    return np.maximum(blackbody(np.asarray(values.number(plug.input("Temperature")), float)), 0)


def _separate(values, plug):
    """Into the output's component, by its place."""
    source = np.asarray(values.colour(plug.inputs()[0]))
    mode = getattr(plug.node, "mode", "HSV" if plug.node.type == "SEPHSV" else "RGB")
    if mode not in ("RGB", "HSV"):
        raise UnknownNode(f"{plug.node.bl_label} ({mode})")
    source = hsv_from_rgb(source) if mode == "HSV" else source
    return source[..., list(plug.node.outputs).index(plug.socket)]


def _combine(values, plug):
    parts = np.stack(np.broadcast_arrays(*(values.number(p) for p in plug.inputs()[:3])), -1)
    mode = getattr(plug.node, "mode", "HSV" if plug.node.type == "COMBHSV" else "RGB")
    if mode not in ("RGB", "HSV"):
        raise UnknownNode(f"{plug.node.bl_label} ({mode})")
    return rgb_from_hsv(parts) if mode == "HSV" else parts


def _mapping(values, plug):
    names = ("Vector", "Location", "Rotation", "Scale")
    vector, location, rotation, scale = (
        values.colour(plug.input(name)) if _has(plug, name) else np.zeros(3) for name in names
    )
    turn = node_maths.rotation_matrix(rotation)
    kind = plug.node.vector_type
    if kind == "TEXTURE":
        return node_maths.divided((vector - location) @ turn, scale)
    if kind == "POINT":
        return (vector * scale) @ turn.T + location
    if kind == "VECTOR":
        return (vector * scale) @ turn.T
    return node_maths.normalised((node_maths.divided(vector, scale)) @ turn.T)


def _has(plug, name):
    return any(p.socket.name == name for p in plug.inputs())


NODES = {
    "VALUE": _value,
    "RGB": _rgb,
    "MATH": _math,
    "VECT_MATH": _vector_math,
    "MIX_RGB": _mix_rgb,
    "MIX": _mix,
    "VALTORGB": _colour_ramp,
    "CURVE_RGB": _rgb_curves,
    "CURVE_VEC": _vector_curves,
    "CURVE_FLOAT": _float_curve,
    "MAP_RANGE": _map_range,
    "CLAMP": _clamp,
    "GAMMA": _gamma,
    "BRIGHTCONTRAST": _bright_contrast,
    "HUE_SAT": _hue_saturation,
    "INVERT": _invert,
    "RGBTOBW": _grey,
    "BLACKBODY": _blackbody,
    "SEPRGB": _separate,
    "SEPXYZ": _separate,
    "SEPHSV": _separate,
    "SEPARATE_COLOR": _separate,
    "COMBRGB": _combine,
    "COMBXYZ": _combine,
    "COMBHSV": _combine,
    "COMBINE_COLOR": _combine,
    "MAPPING": _mapping,
    **TEXTURES,
}
