"""The arithmetic of Blender's Math, Vector Math, Mix and Map Range nodes, element by element, in NumPy."""

import numpy as np
from mathutils import Euler


def divided(a, b):
    """Safe division: 0 where the divisor is 0."""
    b = np.asarray(b, float)
    return np.where(b != 0, a / np.where(b != 0, b, 1), 0.0)


def normalised(v):
    return divided(v, np.linalg.norm(v, axis=-1, keepdims=True))


def _modulo(a, b):
    return np.where(np.asarray(b) != 0, np.fmod(a, np.where(np.asarray(b) != 0, b, 1)), 0.0)


def _power(a, b):
    a, b = np.broadcast_arrays(np.asarray(a, float), np.asarray(b, float))
    whole = b == np.round(b)
    with np.errstate(all="ignore"):
        result = np.where((a < 0) & ~whole, 0.0, np.power(np.where((a < 0) & ~whole, 1, a), b))
    return np.where(np.isfinite(result), result, 0.0)


def _logarithm(a, b):
    ok = (np.asarray(a) > 0) & (np.asarray(b) > 0)
    return divided(np.log(np.where(ok, a, 1.0)), np.log(np.where(ok, b, 1.0)))


def _wrap(x, high, low):
    span = np.asarray(high) - low
    return np.where(span != 0, x - span * np.floor(divided(np.asarray(x) - low, span)), low)


def _ping_pong(x, scale):
    fraction = divided(np.asarray(x) - scale, np.asarray(scale) * 2)
    return np.where(np.asarray(scale) != 0, np.abs((fraction - np.floor(fraction)) * scale * 2 - scale), 0.0)


def _smooth_min(a, b, c):
    c = np.asarray(c, float)
    h = np.where(c != 0, np.maximum(c - np.abs(np.asarray(a) - b), 0) / np.where(c != 0, c, 1), 0)
    return np.minimum(a, b) - h**3 * c / 6


_SCALAR = {
    "ADD": lambda a, b, c: a + b,
    "SUBTRACT": lambda a, b, c: a - b,
    "MULTIPLY": lambda a, b, c: a * b,
    "DIVIDE": lambda a, b, c: divided(a, b),
    "MULTIPLY_ADD": lambda a, b, c: a * b + c,
    "POWER": lambda a, b, c: _power(a, b),
    "LOGARITHM": lambda a, b, c: _logarithm(a, b),
    "SQRT": lambda a, b, c: np.sqrt(np.maximum(a, 0)),
    "INVERSE_SQRT": lambda a, b, c: divided(1.0, np.sqrt(np.maximum(a, 0))),
    "ABSOLUTE": lambda a, b, c: np.abs(a),
    "EXPONENT": lambda a, b, c: np.exp(a),
    "MINIMUM": lambda a, b, c: np.minimum(a, b),
    "MAXIMUM": lambda a, b, c: np.maximum(a, b),
    "LESS_THAN": lambda a, b, c: np.where(np.asarray(a) < b, 1.0, 0.0),
    "GREATER_THAN": lambda a, b, c: np.where(np.asarray(a) > b, 1.0, 0.0),
    "SIGN": lambda a, b, c: np.sign(a),
    "COMPARE": lambda a, b, c: np.where(np.abs(np.asarray(a) - b) <= np.maximum(c, 1.1920929e-07), 1.0, 0.0),
    "SMOOTH_MIN": _smooth_min,
    "SMOOTH_MAX": lambda a, b, c: -_smooth_min(-np.asarray(a), -np.asarray(b), c),
    "ROUND": lambda a, b, c: np.floor(np.asarray(a) + 0.5),
    "FLOOR": lambda a, b, c: np.floor(a),
    "CEIL": lambda a, b, c: np.ceil(a),
    "TRUNC": lambda a, b, c: np.trunc(a),
    "FRACT": lambda a, b, c: a - np.floor(a),
    "MODULO": lambda a, b, c: _modulo(a, b),
    "WRAP": _wrap,
    "SNAP": lambda a, b, c: np.floor(divided(a, b)) * b,
    "PINGPONG": lambda a, b, c: _ping_pong(a, b),
    "SINE": lambda a, b, c: np.sin(a),
    "COSINE": lambda a, b, c: np.cos(a),
    "TANGENT": lambda a, b, c: np.tan(a),
    "ARCSINE": lambda a, b, c: np.arcsin(np.clip(a, -1, 1)),
    "ARCCOSINE": lambda a, b, c: np.arccos(np.clip(a, -1, 1)),
    "ARCTANGENT": lambda a, b, c: np.arctan(a),
    "ARCTAN2": lambda a, b, c: np.arctan2(a, b),
    "SINH": lambda a, b, c: np.sinh(a),
    "COSH": lambda a, b, c: np.cosh(a),
    "TANH": lambda a, b, c: np.tanh(a),
    "RADIANS": lambda a, b, c: np.radians(a),
    "DEGREES": lambda a, b, c: np.degrees(a),
}


def scalar(operation, a, b, c):
    """Of the Math node; None: no such operation."""
    compute = _SCALAR.get(operation)
    return compute(a, b, c) if compute else None


def _dot(a, b):
    return (np.asarray(a) * b).sum(-1)


_VECTOR = {
    "ADD": lambda a, b, c, s: a + b,
    "SUBTRACT": lambda a, b, c, s: a - b,
    "MULTIPLY": lambda a, b, c, s: a * b,
    "DIVIDE": lambda a, b, c, s: divided(a, b),
    "MULTIPLY_ADD": lambda a, b, c, s: a * b + c,
    "CROSS_PRODUCT": lambda a, b, c, s: np.cross(a, b),
    "DOT_PRODUCT": lambda a, b, c, s: _dot(a, b),
    "DISTANCE": lambda a, b, c, s: np.linalg.norm(a - b, axis=-1),
    "LENGTH": lambda a, b, c, s: np.linalg.norm(a, axis=-1),
    "SCALE": lambda a, b, c, s: a * np.asarray(s)[..., None],
    "NORMALIZE": lambda a, b, c, s: normalised(a),
    "PROJECT": lambda a, b, c, s: b * divided(_dot(a, b), _dot(b, b))[..., None],
    "REFLECT": lambda a, b, c, s: a - 2 * normalised(b) * _dot(a, normalised(b))[..., None],
    "ABSOLUTE": lambda a, b, c, s: np.abs(a),
    "MINIMUM": lambda a, b, c, s: np.minimum(a, b),
    "MAXIMUM": lambda a, b, c, s: np.maximum(a, b),
    "FLOOR": lambda a, b, c, s: np.floor(a),
    "CEIL": lambda a, b, c, s: np.ceil(a),
    "FRACTION": lambda a, b, c, s: a - np.floor(a),
    "MODULO": lambda a, b, c, s: _modulo(a, b),
    "SNAP": lambda a, b, c, s: np.floor(divided(a, b)) * b,
    "SINE": lambda a, b, c, s: np.sin(a),
    "COSINE": lambda a, b, c, s: np.cos(a),
    "TANGENT": lambda a, b, c, s: np.tan(a),
}


def vector(operation, a, b, c, scale):
    """Of the Vector Math node, a vector or a number as the operation has it; None: no such operation."""
    compute = _VECTOR.get(operation)
    return compute(np.asarray(a, float), np.asarray(b, float), np.asarray(c, float), scale) if compute else None


_BLEND = {
    "MIX": lambda t, a, b: a + (b - a) * t,
    "ADD": lambda t, a, b: a + b * t,
    "SUBTRACT": lambda t, a, b: a - b * t,
    "MULTIPLY": lambda t, a, b: a * (1 - t + b * t),
    "SCREEN": lambda t, a, b: 1 - (1 - t + t * (1 - b)) * (1 - a),
    "DIFFERENCE": lambda t, a, b: a + (np.abs(a - b) - a) * t,
    "DIVIDE": lambda t, a, b: np.where(b != 0, (1 - t) * a + t * divided(a, b), a),
    "DARKEN": lambda t, a, b: a + (np.minimum(a, b) - a) * t,
    "LIGHTEN": lambda t, a, b: a + (np.maximum(a, b) - a) * t,
    "LINEAR_LIGHT": lambda t, a, b: a + t * (2 * b - 1),
    "OVERLAY": lambda t, a, b: np.where(a < 0.5, a * (1 - t + 2 * t * b), 1 - (1 - t + 2 * t * (1 - b)) * (1 - a)),
}


def blended(kind, factor, a, b):
    """Of the Mix node's colours; None: no such blend. @param factor  of (N, 1)"""
    compute = _BLEND.get(kind)
    return compute(factor, np.asarray(a, float), np.asarray(b, float)) if compute else None


def map_range(interpolation, x, from_min, from_max, to_min, to_max, steps, clamp):
    span = np.asarray(from_max) - from_min
    factor = divided(np.asarray(x) - from_min, span)
    if interpolation == "STEPPED":
        factor = np.where(np.asarray(steps) > 0, divided(np.floor(factor * (steps + 1)), steps), 0)
    elif interpolation == "SMOOTHSTEP":
        factor = np.clip(factor, 0, 1)
        factor = factor * factor * (3 - 2 * factor)
    elif interpolation == "SMOOTHERSTEP":
        factor = np.clip(factor, 0, 1)
        factor = factor**3 * (factor * (factor * 6 - 15) + 10)
    result = np.where(span != 0, to_min + factor * (np.asarray(to_max) - to_min), 0.0)
    if clamp and interpolation in ("LINEAR", "STEPPED"):
        result = np.clip(result, np.minimum(to_min, to_max), np.maximum(to_min, to_max))
    return result


def rotation_matrix(euler):
    """Of a rotation about x, then y, then z, for columns. @param euler  three numbers [radians]"""
    return np.array(Euler([float(v) for v in np.ravel(euler)[:3]]).to_matrix())
