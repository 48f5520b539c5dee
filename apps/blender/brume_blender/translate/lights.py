"""Lamps. Blender's watts become radiance of areas and spheres, intensity of points and spots; a sun's strength is
irradiance."""

import math

import bpy
import numpy as np
from mathutils import Vector

from .node_values import UnknownNode, Values
from .nodes import output_of, tree_of
from .notes import LeftOut
from .toml_text import Table

# Until then the intensity of Cycles' spots falls off with the cosine to the axis, too (measured with 3.4).
COSINE_SPOTS_BEFORE = (3, 5, 0)


def light_table(instance, notes):
    """@throws LeftOut"""
    thing = instance.object
    light, name = thing.data, thing.name
    cycles = getattr(light, "cycles", None)
    if light.type == "AREA" and getattr(cycles, "is_portal", False):
        raise LeftOut("the light is a portal, which brume needs none of")
    colour = Vector(light.color) * light.energy * 2 ** getattr(light, "exposure", 0)  # since Blender 4.5, as the next two
    if getattr(light, "use_temperature", False):
        colour = Vector(c * f for c, f in zip(colour, light.temperature_color))
    if not getattr(light, "normalize", True):
        colour *= light.area(matrix_world=instance.matrix_world)
    colour = Vector(c * f for c, f in zip(colour, _emitted(light, name, notes)))
    if min(colour) < 0:
        raise LeftOut("a light of negative strength")
    if not getattr(cycles, "cast_shadow", light.use_shadow):  # the light's own since Blender 4.2
        notes.say(name, "its light casts shadows in brume")
    _say_visibility(thing, notes)
    matrix = instance.matrix_world
    table = Table("[[lights]]")
    make = {"SUN": _sun, "POINT": _point, "SPOT": _spot, "AREA": _area}[light.type]
    make(table, light, name, matrix, colour, notes)
    if thing.visible_camera and light.type in ("AREA", "POINT"):
        table.set(visible_to_camera=True)
    return table


def _emitted(light, name, notes):
    """Factor on a light's colour by its nodes."""
    if tree_of(light) is None:
        return (1, 1, 1)
    shader = output_of(light.node_tree, "Surface")
    if shader is None:
        return (0, 0, 0)
    if shader.node.type != "EMISSION":
        notes.say(name, f"its shader {shader.node.bl_label} is left out; Emission of strength 1 is taken")
        return (1, 1, 1)

    def leaves(plug):
        if plug.node.type != "LIGHT_FALLOFF":
            return None
        if plug.socket.name != "Quadratic":
            notes.say(name, f"its {plug.socket.name.lower()} falloff is left out; its light falls with the square of the distance")
        return Values(leaves).number(plug.input("Strength"))

    def read(plug, size):
        try:
            values = Values(leaves)
            return values.number(plug) if size == 1 else values.colour(plug)
        except UnknownNode as unknown:
            notes.say(name, f"'{plug.socket.name}' of its light depends on {unknown}, which brume lacks; its value without is taken")
            value = plug.socket.default_value
            return value if size == 1 else np.array(value[:3])

    strength, colour = read(shader.input("Strength"), 1), read(shader.input("Color"), 3)
    return [float(strength * c) for c in np.ravel(colour)]


def _say_visibility(thing, notes):
    unseen = [kind for kind in ("diffuse", "glossy", "transmission", "volume_scatter") if not getattr(thing, f"visible_{kind}")]
    linked = getattr(thing, "light_linking", None)  # Blender 4.0
    if linked is not None and (linked.receiver_collection or linked.blocker_collection):
        notes.say(thing.name, "its light reaches all objects, and all cast its shadows")
    if unseen:
        notes.say(thing.name, f"its light reaches rays of every kind in brume, {' and '.join(unseen).replace('_', ' ')} too")


def _axis(matrix, column):
    return matrix.to_3x3().normalized().col[column]


def _sun(table, light, name, matrix, colour, notes):
    table.set(type="sun", direction=_axis(matrix, 2), irradiance=colour, angular_diameter=math.degrees(light.angle))


def _point(table, light, name, matrix, colour, notes):
    radius = light.shadow_soft_size
    if radius > 0:
        table.set(type="sphere", position=matrix.translation, radius=radius, radiance=colour / (4 * math.pi**2 * radius**2), solid=False)
    else:
        table.set(type="point", position=matrix.translation, intensity=colour / (4 * math.pi))


def _spot(table, light, name, matrix, colour, notes):
    if light.shadow_soft_size > 0:
        notes.say(name, f"its radius of {light.shadow_soft_size:.4g} is left out: brume's spots are points")
    half = 0.5 * light.spot_size
    # Blender fades by the cosine, brume by the angle.
    inner = math.acos(min(1.0, math.cos(half) + (1 - math.cos(half)) * light.spot_blend))
    table.set(
        type="spot",
        position=matrix.translation,
        direction=-_axis(matrix, 2),
        intensity=colour / (4 * math.pi),
        cone_angle=min(math.degrees(2 * half), 179.9),
        cone_softness=min(max(1 - inner / half, 0), 1),
    )
    if bpy.app.version < COSINE_SPOTS_BEFORE:
        table.set(cosine_falloff=True)


def _area(table, light, name, matrix, colour, notes):
    if light.spread < math.pi:
        notes.say(name, f"its spread of {math.degrees(light.spread):.4g} degrees is left out: it shines to all sides in front")
    size_x, size_y = light.size, light.size_y if light.shape in ("RECTANGLE", "ELLIPSE") else light.size
    if light.shape in ("DISK", "ELLIPSE"):
        notes.say(name, "its ellipse is a rectangle of the same area and power here")
        size_x, size_y = size_x * math.sqrt(math.pi) / 2, size_y * math.sqrt(math.pi) / 2
    edge_x, edge_y = matrix.to_3x3() @ Vector((size_x, 0, 0)), matrix.to_3x3() @ Vector((0, -size_y, 0))
    normal = edge_x.cross(edge_y)
    if normal.dot(-_axis(matrix, 2)) < 0:  # a mirrored lamp shines on along its -z
        edge_y, normal = -edge_y, -normal
    if not normal.length > 0:
        raise LeftOut("a light without an area")
    table.set(type="rectangle", position=matrix.translation, edge_x=edge_x, edge_y=edge_y)
    table.set(radiance=colour / (4 * normal.length), solid=False)
