"""Coefficients that are functions of grids, as what brume renders: volumes whose coefficient is a curve of one grid times
a colour. Several may overlap and add up, so that any function of one grid becomes at most three.
"""

from dataclasses import dataclass, field

import numpy as np

from .colour import blackbody
from .notes import LeftOut
from .volume_shaders import SIGMA

# Where curves are sampled: whatever a grid holds, by 2 % of its value; and where Blender's ramps have their entries.
STORED = np.unique(np.concatenate([[0.0], np.geomspace(1e-6, 1e6, 1396), np.arange(1, 256) / 255]))
TOLERANCE = 1e-3  # of a curve's points between those that are kept, relative to its value


@dataclass
class Part:
    """A medium: sigma(x) = curve(grid(x)) * sigma."""

    grid: str
    curve: list  # [[stored, meant], ...], or None: the grid itself
    sigma_s: np.ndarray = field(default_factory=lambda: np.zeros(3))
    sigma_a: np.ndarray = field(default_factory=lambda: np.zeros(3))
    lobes: list = field(default_factory=list)  # (g, sigma_s) of its scatters
    colour_grid: str = ""


def thinned(x, y):
    """Points of a curve between which straight lines keep it within the tolerance. @param y  of (N, channels)"""
    kept, last, i = [0], 0, 1
    while last < len(x) - 1:
        step, best = 1, last + 1
        while last + step < len(x):  # doubling, then back: lines are mostly long
            if not _straight(x, y, last, last + step):
                break
            best, step = last + step, step * 2
        lo, hi = best, min(last + step, len(x) - 1)
        while lo < hi:
            middle = (lo + hi + 1) // 2
            lo, hi = (middle, hi) if _straight(x, y, last, middle) else (lo, middle - 1)
        kept.append(lo)
        last = lo
    return kept


def _straight(x, y, a, b):
    if b - a < 2:
        return True
    f = ((x[a : b + 1] - x[a]) / (x[b] - x[a]))[:, None]
    line = y[a] + f * (y[b] - y[a])
    size = np.abs(y[a : b + 1]).max(-1, keepdims=True)
    return bool(np.all(np.abs(line - y[a : b + 1]) <= TOLERANCE * size + 1e-12))


def _linear(values):
    """What multiplies the grid, where a function of it is that; None: it is more. @param values  at STORED, of (N,)"""
    slope = values[-1] / STORED[-1]
    return slope if np.all(np.abs(values - slope * STORED) <= 1e-6 * np.abs(slope) * STORED) else None


def _curves(values):
    """(curve, colour) pairs whose products add up to a function of a grid. @param values  at STORED, of (N, 3)"""
    values = np.maximum(values, 0)
    if not values.any():
        return []
    peak = values[:, np.argmax(values.max(0))]
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.where(peak[:, None] > 0, values / peak[:, None], np.nan)
    known = ratio[peak > 0]
    if np.all(np.ptp(known, axis=0) <= 1e-5):
        return [_scaled(peak, known[-1])]
    return [_scaled(values[:, c], np.eye(3)[c]) for c in range(3) if values[:, c].any()]


def _scaled(values, colour):
    slope = _linear(values)
    if slope is not None:
        return None, slope * colour
    at_one = values[np.searchsorted(STORED, 1.0)]
    unit = at_one if at_one > 0 else values.max()
    kept = thinned(STORED, values[:, None] / unit)
    return [[STORED[i], values[i] / unit] for i in kept], unit * colour


def media(shader, closures, grids, name, notes):
    """Parts for what a shader's closures scatter and absorb. @throws LeftOut"""
    return [
        part
        for closure in closures
        if closure.kind in ("scatter", "absorption")
        for part in _media_of(shader, closure, grids, name, notes)
    ]


def _media_of(shader, closure, grids, name, notes):
    grid = _driver(shader, closure, grids, name, notes)
    if grid is None:
        return
    fixed = {other: np.ones(len(STORED)) for other in shader.used(closure) if other != grid}
    for curve, colour in _curves(shader.evaluate(closure, {grid: STORED, **fixed})):
        if curve is not None:
            if curve[0][1] > 0:
                notes.say(name, f"its density is above 0 where the grid '{grid}' is 0: there it is left out")
        part = Part(grid, curve, colour_grid=closure.colour_grid)
        if closure.kind == "scatter":
            part.sigma_s, part.lobes = colour, [(closure.g, colour)]
        else:
            part.sigma_a = colour
        yield part


def _driver(shader, closure, grids, name, notes):
    """The grid that a coefficient follows; None: it is zero. @throws LeftOut"""
    used = shader.used(closure)
    if not used:
        if not shader.evaluate(closure, {}).any():
            return None
        raise LeftOut(f"no grid of its file drives its density; it has: {', '.join(grids) or 'none'}")
    if len(used) > 1:
        first = "density" if "density" in used else used[0]
        others = ", ".join(f"'{g}'" for g in used if g != first)
        notes.say(name, f"its density depends on the grids '{first}' and {others} together; '{first}' alone is taken, at 1 of the other")
        return first
    return used[0]


def merged(parts):
    """With those of the same grid and curve as one: absorption to any, scatterings while they have two lobes."""
    made = []
    for part in parts:
        _merge(made, part)
    return made


def _merge(parts, part):
    for other in parts:
        if other.grid != part.grid or other.curve != part.curve:
            continue
        if other.colour_grid and part.colour_grid and other.colour_grid != part.colour_grid:
            continue
        lobes = joined(other.lobes, part.lobes)
        if lobes is None:
            continue
        other.lobes = lobes
        other.sigma_s = other.sigma_s + part.sigma_s
        other.sigma_a = other.sigma_a + part.sigma_a
        other.colour_grid = other.colour_grid or part.colour_grid
        return
    parts.append(part)


def joined(lobes, more):
    """Lobes of a sum of scatterings; None: brume has no phase function for it. Two lobes share one colour there."""
    sums = {}
    for g, sigma in [*lobes, *more]:
        sums[g] = sums.get(g, 0) + sigma
    if len(sums) > 2:
        return None
    if len(sums) == 2:
        a, b = sums.values()
        if np.abs(np.cross(a, b)).max() > 1e-6 * np.abs(a).max() * np.abs(b).max():
            return None
    return list(sums.items())


def set_medium(table, part):
    if part.curve is not None:
        table.set(remap=part.curve)
    set_coefficients(table, part.sigma_s, part.sigma_a, part.lobes)
    if part.colour_grid:
        table.set(albedo_grid=part.colour_grid)


def set_coefficients(table, sigma_s, sigma_a, lobes):
    table.set(sigma_s=sigma_s, sigma_a=sigma_a)
    g = [min(max(lobe[0], -0.999), 0.999) for lobe in lobes]
    if len(g) == 2:
        share = lobes[1][1].sum() / (lobes[0][1].sum() + lobes[1][1].sum())
        table.set(phase="two_lobes", g=g[0], g2=g[1], lobe_weight=share)
    elif g and g[0] != 0:
        table.set(g=g[0])


@dataclass
class Glow:
    """What a volume emits by one grid; the grid may be empty: the same everywhere."""

    grid: str
    ramp: list = None  # [[value, r, g, b], ...]; of no grid: one colour
    kelvin: float = 0  # of a black body, for one unit of the grid
    intensity: float = 0

    def set(self, table, stored):
        """@param stored  the grid's name in its file"""
        if self.ramp is not None:
            table.set(flame_grid=stored, flame_ramp=self.ramp)
        else:
            table.set(temperature_grid=stored, temperature_scale=self.kelvin)
            table.set(blackbody_intensity=self.intensity, blackbody_law="stefan_boltzmann")


def glows(shader, closures, name, notes):
    """A Glow for each grid by which a shader's closures emit."""
    sums = {}
    for closure in closures:
        if closure.kind not in ("emission", "black_body"):
            continue
        used = shader.used(closure)
        if len(used) > 1:
            notes.say(name, f"its emission depends on the grids {', '.join(used)} together; '{used[0]}' alone is taken, at 1 of the others")
        grid = used[0] if used else ""
        at = {grid: STORED, **{other: np.ones(len(STORED)) for other in used[1:]}} if grid else {}
        values = shader.evaluate(closure, at)
        if closure.kind == "black_body":
            kelvin = _linear(values) if grid else None
            if kelvin is not None:
                if kelvin > 0:
                    yield Glow(grid, kelvin=kelvin, intensity=closure.intensity)
                continue
            values = (SIGMA * closure.intensity * values**4)[:, None] * np.maximum(blackbody(values), 0)
        if values.any():
            sums[grid] = sums.get(grid, 0) + np.maximum(values, 0)
    for grid, values in sums.items():
        if not grid:
            yield Glow("", list(values[0]))
            continue
        if values[0].any():
            notes.say(name, f"its emission is above 0 where the grid '{grid}' is 0: there it is left out")
            values[0] = 0
        yield Glow(grid, [[STORED[i], *values[i]] for i in thinned(STORED, values)])
