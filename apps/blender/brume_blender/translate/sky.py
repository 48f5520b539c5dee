"""Sky textures: brume's one sky, Preetham's, stands in for all of Blender's."""

import math

# Radiance of Blender's skies over that of brume's, whose unit is kcd / (m^2 sr): see tests/blender/README.md.
SCALE = {"PREETHAM": 1.0, "HOSEK_WILKIE": 1.0, "NISHITA": 1.0}


def fill(table, node, strength, name, notes):
    """Sets a sky, and with Nishita's its sun."""
    nishita = node.sky_type not in ("PREETHAM", "HOSEK_WILKIE")
    if nishita:
        elevation, turn = node.sun_elevation, node.sun_rotation
        direction = [math.cos(elevation) * math.sin(turn), math.cos(elevation) * math.cos(turn), math.sin(elevation)]
    else:
        direction = list(node.sun_direction)
    if direction[2] < 0.02:
        notes.say(name, "its sun stands at or below the horizon; a sky with the sun just above it is taken")
        direction[2] = 0.02
    table.set(
        sky="preetham",
        radiance=[strength * SCALE.get(node.sky_type, SCALE["NISHITA"])] * 3,
        turbidity=min(max(2.2 if nishita else node.turbidity, 1.9), 10),
        sun_direction=direction,
        sky_sun=bool(nishita and node.sun_disc),
        ground_albedo=0.0 if nishita else node.ground_albedo if node.sky_type == "HOSEK_WILKIE" else 0.0,
    )
    if node.sky_type != "PREETHAM":
        notes.say(name, f"its sky ({node.sky_type.replace('_', ' ').title()}) is Preetham's, of the same sun and brightness")
