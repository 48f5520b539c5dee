"""Sky textures: brume's one sky, Preetham's, stands in for all of Blender's, and a sun of its own for Nishita's.

The factors make it as bright as Cycles 3.4 has each of them, on a level plane, at a turbidity of 2.2 and clear air.
"""

import math

import numpy as np

from .toml_text import Table

ELEVATIONS = [3, 8, 15, 30, 50, 70, 89]  # of the sun [degrees]
# Blender's radiance over that of brume's sky, whose unit is kcd / (m^2 sr), by elevation and channel.
FACTORS = {
    "PREETHAM": [
        [0.121, 0.131, 0.152], [0.119, 0.130, 0.148], [0.117, 0.128, 0.144], [0.117, 0.127, 0.138], [0.124, 0.131, 0.137],
        [0.132, 0.135, 0.139], [0.136, 0.137, 0.140],
    ],
    "HOSEK_WILKIE": [
        [0.00941, 0.0108, 0.0123], [0.0116, 0.0150, 0.0180], [0.0129, 0.0170, 0.0194], [0.0143, 0.0181, 0.0188],
        [0.0155, 0.0195, 0.0207], [0.0185, 0.0219, 0.0236], [0.0189, 0.0210, 0.0199],
    ],
    "NISHITA": [
        [0.394, 0.447, 0.526], [0.594, 0.685, 0.773], [0.713, 0.774, 0.792], [0.804, 0.775, 0.677], [0.895, 0.801, 0.674],
        [0.991, 0.866, 0.751], [0.928, 0.770, 0.626],
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
    notes.say(name, f"its sky ({model.replace('_', ' ').title()}) is brume's clear sky, as bright on a level plane")
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
