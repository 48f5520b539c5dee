"""Sky textures. Brume's sky is Blender's Preetham; it stands in for the others, and a sun of its own for Nishita's.

The factors make it as bright as Cycles 3.4 has them, on a level plane, at a turbidity of 2.2 and in clear air.
"""

import math

import numpy as np

from .toml_text import Table

ELEVATIONS = [3, 8, 15, 30, 50, 70, 89]  # of the sun [degrees]
# Blender's radiance over that of brume's sky, whose unit is kcd / (m^2 sr), by elevation and channel.
FACTORS = {
    "PREETHAM": [[0.06] * 3] * 7,
    "HOSEK_WILKIE": [
        [0.00466, 0.00496, 0.00485], [0.00583, 0.00693, 0.00729], [0.00663, 0.00795, 0.00811], [0.00736, 0.00856, 0.00820],
        [0.00749, 0.00896, 0.00906], [0.00836, 0.00970, 0.0102], [0.00833, 0.00917, 0.00853],
    ],
    "NISHITA": [
        [0.195, 0.205, 0.208], [0.299, 0.316, 0.313], [0.366, 0.362, 0.331], [0.414, 0.366, 0.295], [0.433, 0.368, 0.296],
        [0.449, 0.384, 0.325], [0.410, 0.337, 0.269],
    ],
}  # fmt: skip
# Irradiance of Nishita's sun on a plane that faces it [W/m^2].
SUN = [
    [45.7, 19.1, 1.52], [94.8, 58.8, 21.3], [121.3, 87.7, 48.7], [140.0, 111.1, 79.0], [147.7, 121.5, 94.8], [150.6, 125.4, 101.1],
    [151.3, 126.3, 102.7],
]  # fmt: skip
LOWEST = math.sin(math.radians(1.5))  # at which brume's sun may stand


def sky_tables(table, node, strength, name, notes):
    """Fills [environment], and returns [[lights]] of the sky's sun."""
    model = node.sky_type if node.sky_type in FACTORS else "NISHITA"
    direction = _sun_direction(node, model)
    if direction[2] < LOWEST:
        notes.say(name, "its sun stands at or below the horizon; a sky with the sun just above it is taken")
        direction[2] = LOWEST
    elevation = math.degrees(math.asin(min(direction[2] / np.linalg.norm(direction), 1)))
    table.set(
        sky="preetham",
        radiance=strength * _at(FACTORS[model], elevation),
        turbidity=2.2 if model == "NISHITA" else min(max(node.turbidity, 1.9), 10),
        sun_direction=direction,
        sky_sun=False,
        # Below the horizon Nishita's is black, the others are as bright as there.
        ground_albedo=0 if model == "NISHITA" else 1,
    )
    if model == "PREETHAM":
        notes.say(name, "below the horizon its sky is ground that it lights")
    else:
        notes.say(name, f"its sky ({node.sky_type.replace('_', ' ').title()}) is Preetham's, as bright on a level plane")
    if model != "NISHITA" or not node.sun_disc:
        return []
    sun = Table("[[lights]]").set(type="sun", direction=direction, visible_to_camera=True)
    sun.set(irradiance=strength * node.sun_intensity * _at(SUN, elevation), angular_diameter=math.degrees(node.sun_size))
    return [sun]


def _sun_direction(node, model):
    if model != "NISHITA":
        return list(node.sun_direction)
    level = math.cos(node.sun_elevation)
    return [level * math.sin(node.sun_rotation), level * math.cos(node.sun_rotation), math.sin(node.sun_elevation)]


def _at(rows, elevation):
    return np.array([np.interp(elevation, ELEVATIONS, channel) for channel in np.transpose(rows)])
