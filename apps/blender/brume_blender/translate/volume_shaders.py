"""What a volume shader does with light, as coefficients that are functions of grids.

Principled Volume, Volume Scatter, Volume Absorption, Emission, sums and mixtures of them: each becomes closures, whose
coefficient [1 / scene unit] a `Values` evaluates for any values of the grids. What drives a shader that is no grid, no
number and no node of node_values is said, and a number taken for what it gives.
"""

from dataclasses import dataclass
from typing import Callable

import numpy as np

from .colour import blackbody
from .frozen import frozen, signature_of
from .node_values import UnknownNode, Values

SIGMA = 5.670373e-8 * 1e-6 / np.pi  # Stefan and Boltzmann's, in Blender's units of brightness
OTHER_PHASES = {"RAYLEIGH": 0.0, "MIE": 0.87, "FOURNIER_FORAND": 0.92}  # mean cosines of those without an anisotropy
POINTWISE = ("TEX_COORD", "NEW_GEOMETRY")  # nodes whose outputs differ from point to point
STAND_IN = 0.5  # for nodes without a counterpart
INFO_GRIDS = {"Color": "color", "Density": "density", "Flame": "flame", "Temperature": "temperature"}


@dataclass
class Closure:
    """A part of what happens to light in a volume."""

    kind: str  # scatter, absorption, emission or black_body
    # Of a Values and its GridValues: (N, 3) or (3,) [1 / scene unit; of emission: radiance / scene unit]; of a black body
    # its temperature, (N,) or a number [K]
    coefficient: Callable
    g: float = 0.0
    colour_grid: str = ""  # that multiplies a scatter's colour
    intensity: float = 0.0  # of a black body


class GridValues:
    """Leaves of volume shaders: the grids' values and what a place gives at points, and which were asked for.
    @param values    arrays by the grid's name: (N,) of numbers, (N, 3) of colours
    @param derived   by name: (grid, function of its values), for attributes that are no grids
    @param place     a Place, or None: nothing depends on it   @param points  (N, 3); None: the origin"""

    def __init__(self, values, constants, derived, place, points=None):
        self._values, self._constants, self._derived = values, constants, derived
        self._place, self._points = place, np.zeros(3) if points is None else points
        self.asked, self.derived, self.missing, self.asked_points = set(), set(), set(), False

    def __call__(self, plug):
        name = grid_of(plug)
        if name is None:
            return self._at_place(plug)
        if not self.has(name) and plug.node.type == "ATTRIBUTE":
            self.missing.add(name)
        value = np.asarray(self.value(name))
        is_colour = name in self._constants or value.ndim == 2
        if plug.socket.type == "VALUE":
            return value.mean(-1) if is_colour else value
        return value if is_colour else np.repeat(value[..., None], 3, -1)

    def _at_place(self, plug):
        value = self._place.leaf(plug, self._points) if self._place is not None else None
        if value is not None and plug.node.type in POINTWISE:
            self.asked_points = True
        return value

    def generated(self):
        self.asked_points = True
        return self._place.generated(self._points)

    def has(self, name):
        return name in self._values or name in self._derived or name in self._constants

    def value(self, name):
        """0 for grids that are not there, as in Blender."""
        if name in self._constants:
            return self._constants[name]
        if name in self._values:  # of attributes that are no grids, too, where they were computed voxel by voxel
            self.asked.add(name)
            return self._values[name]
        if name in self._derived:
            self.derived.add(name)
            grid, function = self._derived[name]
            return function(self.value(grid))
        return 0.0


def grid_of(plug):
    """The grid that an output reads; None: it reads none."""
    node = plug.node
    if node.type == "ATTRIBUTE" and node.attribute_type == "GEOMETRY":
        return node.attribute_name
    if node.type == "VOLUME_INFO":
        return INFO_GRIDS.get(plug.socket.name)
    return None


class VolumeShader:
    """Closures of a shader. @param plug  what the output node's Volume is; None: Principled Volume as it is from the start,
    which is Blender's default   @param source  of its grids: GridFile, or
    none (fog in a mesh)   @param place  a Place"""

    def __init__(self, plug, name, source, place, notes):
        self.name, self.place, self.notes = name, place, notes
        self._grids, self._colours, self._constants, self._derived = (
            (source.grids, source.colours, source.constants, source.derived) if source is not None else ([], [], {}, {})
        )
        self._missing = set()
        self.closures = []
        plug = plug and frozen(plug, place.depsgraph, place.trees)
        self.signature = plug and signature_of(plug)
        factor = source.factor if source is not None else 1.0
        if plug is not None:
            self._collect(plug.resolve(), lambda values: factor)
            self._say_what_is_missing()
            return
        self._add("scatter", lambda _, leaves: _times(leaves.value("density"), np.full(3, 0.5 * factor)))
        self._add("absorption", lambda _, leaves: _times(leaves.value("density"), np.full(3, 0.5 * factor)))

    def _say_what_is_missing(self):
        for name in sorted(self._missing) if self._grids else ():
            there = ", ".join([*self._grids, *self._colours, *self._derived]) or "none"
            self.notes.say(self.name, f"its shader asks for the grid '{name}', which there is not: it is 0; there are: {there}")
        if self.place is not None and self.place.paths:
            self.notes.say(self.name, "its volume is the same for rays of every kind: what Light Path tells is 0")

    def used(self, closure):
        """The grids that a coefficient depends on."""
        return sorted(self._asked(closure).asked)

    def derived(self, closure):
        """The attributes that are functions of a grid on which a coefficient depends."""
        return sorted(self._asked(closure).derived)

    def bends_space(self, closure):
        """Whether a coefficient depends on where it is asked for, beside the grids."""
        return self._asked(closure).asked_points

    def _asked(self, closure):
        leaves = self._leaves(np.ones(1))
        closure.coefficient(self._values(leaves), leaves)
        return leaves

    def evaluate(self, closure, values, points=None):
        """(N, 3), or (N,) of a black body. @param values  array of (N,) for every grid that it depends on
        @param points  in the object's space, (N, 3)"""
        leaves = GridValues(values, self._constants, self._derived, self.place, points)
        result = np.asarray(closure.coefficient(self._values(leaves), leaves), float)
        count = len(points) if points is not None else len(next(iter(values.values()))) if values else 1
        return np.broadcast_to(result, (count,) if closure.kind == "black_body" else (count, 3))

    def is_linear(self, closure, grid):
        """Whether a coefficient is a multiple of a grid."""
        x = np.array([1e-4, 1e-3, 0.01, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0, 3.0, 100.0])
        y = self.evaluate(closure, {grid: x})
        return np.allclose(y / x[:, None], y[-1] / x[-1], rtol=1e-5, atol=0)

    def _leaves(self, value):
        """All grids at the same values."""
        values = {grid: value for grid in self._grids}
        values.update({grid: np.repeat(value[:, None], 3, -1) for grid in self._colours})
        return GridValues(values, self._constants, self._derived, self.place)

    def _values(self, leaves):
        return Values(leaves, self._stand_in)

    def _stand_in(self, plug, lacking):
        """For what a node without a counterpart gives: the middle of what most give."""
        self.notes.say(self.name, f"its volume depends on {lacking}, which brume lacks; {STAND_IN} is taken for it")
        return STAND_IN if plug.socket.type == "VALUE" else np.full(3, STAND_IN)

    def _has(self, name):
        return name in self._grids or name in self._derived

    def _collect(self, plug, weight):
        if not plug.socket.is_output:
            return
        node = plug.node
        if node.type == "ADD_SHADER":
            for part in plug.inputs():
                self._collect(part.resolve(), weight)
        elif node.type == "MIX_SHADER":
            factor = self._number(plug.input("Fac", "Factor"))
            shares = (lambda v: 1 - np.clip(factor(v), 0, 1), lambda v: np.clip(factor(v), 0, 1))
            for part, share in zip(plug.inputs()[1:], shares):
                self._collect(part.resolve(), lambda v, share=share: weight(v) * share(v))
        elif node.type in _CLOSURES:
            _CLOSURES[node.type](self, plug, weight)
        else:
            self.notes.say(self.name, f"the volume shader {node.bl_label} is left out")

    def _add(self, kind, coefficient, g=0.0, colour_grid=""):
        self.closures.append(Closure(kind, coefficient, g, colour_grid))

    def _read(self, plug, size):
        """A function of a Values for an input."""
        leaves = self._leaves(np.ones(1))
        trial = self._values(leaves)
        trial.number(plug) if size == 1 else trial.colour(plug)
        self._missing |= leaves.missing
        return (lambda values: values.number(plug)) if size == 1 else (lambda values: values.colour(plug))

    def _number(self, plug):
        return self._read(plug, 1)

    def _colour(self, plug):
        """A function of a Values, and the grid of colours that multiplies it."""
        source = plug.resolve()
        name = grid_of(source) if source.socket.is_output else None
        if name in self._constants:
            return (lambda values: self._constants[name]), ""
        if name in self._colours:
            return (lambda values: np.ones(3)), name
        return self._read(plug, 3), ""

    def _fixed(self, plug):
        """A number that is the same everywhere: brume's phase functions are."""
        leaves = self._leaves(np.linspace(0, 1, 5))
        value = np.atleast_1d(self._number(plug)(self._values(leaves)))
        if np.ptp(value) or leaves.asked_points:
            self.notes.say(self.name, f"'{plug.socket.name}' of its volume varies; its mean, {value.mean():.4g}, is taken")
        return float(value.mean())

    def _scatter(self, plug, weight):
        density = self._number(plug.input("Density"))
        colour, grid = self._colour(plug.input("Color"))
        g = self._mean_cosine(plug)
        self._add("scatter", lambda v, _: _times(weight(v) * np.maximum(density(v), 0), colour(v)), g, grid)

    def _mean_cosine(self, plug):
        """Of a Volume Scatter, which has several phase functions since Blender 4.3."""
        phase = getattr(plug.node, "phase", "HENYEY_GREENSTEIN")
        g = OTHER_PHASES.get(phase)
        g = self._fixed(plug.input("Anisotropy")) if g is None else g
        if phase != "HENYEY_GREENSTEIN":
            name = phase.replace("_", " ").title()
            self.notes.say(self.name, f"its phase function {name} is Henyey and Greenstein's, of an anisotropy of {g:.3g}")
        return g

    def _absorption(self, plug, weight):
        density, colour = self._number(plug.input("Density")), self._read(plug.input("Color"), 3)
        self._add("absorption", lambda v, _: _times(weight(v) * np.maximum(density(v), 0), 1 - colour(v)))

    def _emission(self, plug, weight):
        strength, colour = self._number(plug.input("Strength")), self._read(plug.input("Color"), 3)
        self._add("emission", lambda v, _: _times(weight(v) * strength(v), colour(v)))

    def _principled(self, plug, weight):
        node = plug.node
        attribute = {name: plug.input(name + " Attribute").socket.default_value for name in ("Density", "Color", "Temperature")}
        plugged, g = self._number(plug.input("Density")), self._fixed(plug.input("Anisotropy"))
        plugged_colour, colour_grid = self._colour(plug.input("Color"))
        tint = self._constants.get(attribute["Color"], 1.0)
        if attribute["Density"] not in ("", "density") and not self._has(attribute["Density"]):
            self._missing.add(attribute["Density"])
        if attribute["Color"] in self._colours:
            colour_grid = attribute["Color"]

        def colour(values):
            return plugged_colour(values) * tint

        absorbed = self._read(plug.input("Absorption Color"), 3)

        def density(values, leaves):
            d = weight(values) * np.maximum(plugged(values), 0)
            return d * np.maximum(leaves.value(attribute["Density"]), 0) if self._has(attribute["Density"]) else d

        self._add("scatter", lambda v, l: _times(density(v, l), np.maximum(colour(v), 0)), g, colour_grid)
        self._add(
            "absorption",
            lambda v, l: _times(density(v, l), np.maximum(1 - colour(v), 0) * np.maximum(1 - np.sqrt(np.maximum(absorbed(v), 0)), 0)),
        )
        self._glow(plug, weight, attribute["Temperature"])

    def _glow(self, plug, weight, temperature_grid):
        """Principled Volume's own light, which its density does not change."""
        strength, colour = self._number(plug.input("Emission Strength")), self._read(plug.input("Emission Color"), 3)
        self._add("emission", lambda v, _: _times(weight(v) * np.maximum(strength(v), 0), colour(v)))
        intensity, tint = self._number(plug.input("Blackbody Intensity")), self._read(plug.input("Blackbody Tint"), 3)
        plugged = self._number(plug.input("Temperature"))

        def kelvin(values, leaves):
            t = np.asarray(plugged(values), float)
            if self._has(temperature_grid):
                t = t * np.maximum(leaves.value(temperature_grid), 0)
            return np.maximum(t, 0)

        def black_body(values, leaves):
            t, share = kelvin(values, leaves), np.asarray(intensity(values), float)
            power = np.where(share > 0, SIGMA * (1 - share + share * t**4), 0)
            return _times(weight(values) * power, tint(values) * np.maximum(blackbody(t), 0))

        leaves = self._leaves(np.linspace(0, 1, 5))
        trial = self._values(leaves)
        strengths = np.atleast_1d(weight(trial) * intensity(trial))
        if np.ptp(strengths) == 0 and np.all(tint(trial) == 1) and not leaves.asked_points:
            if strengths[0] > 0:
                self.closures.append(Closure("black_body", kelvin, intensity=float(strengths[0])))
        else:
            self._add("emission", black_body)


def _times(number, colour):
    return np.asarray(number, float)[..., None] * colour


_CLOSURES = {
    "VOLUME_SCATTER": VolumeShader._scatter,
    "VOLUME_ABSORPTION": VolumeShader._absorption,
    "EMISSION": VolumeShader._emission,
    "PRINCIPLED_VOLUME": VolumeShader._principled,
}
