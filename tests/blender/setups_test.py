"""Kinds of scenes by how artists set files up: node-made volumes, NLA, overrides, view layers, modifiers, skies, exposure. F12 in
brume against Cycles: the mean within 1 %; or what is said of them. Runs inside Blender."""

import math
import os
import sys

import bpy

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import addon_scene as scenes  # noqa: E402
from builder import Shader, diffuse, scattering  # noqa: E402
from comparison import WITHIN, Comparison  # noqa: E402

# A sky of another law: as bright on a level plane as Blender's, not from every side.
WITHIN_OF = {"under_preetham": 0.02, "under_hosek_wilkie": 0.08, "under_nishita": 0.03}


def fire(b, name="Volume", material=None, location=(-1, -1, -0.7)):
    return b.volume("fire.vdb", name, material or scattering("S", "density", 15, 0.9), location)


def sun(b, energy=3, direction=(0.5, 0.4, -0.6)):
    return b.light("SUN", "Sun", look_at=direction, energy=energy)


def grey(b, size=8, name="Floor"):
    floor = b.mesh("plane", name, diffuse(name, (0.5, 0.5, 0.5)), size=size)
    floor.location.z = -0.7
    return floor


def fog(density=1.5, name="Fog"):
    s = Shader(name)
    return s.volume(s.node("VolumePrincipled", Density=density))


def made_by_nodes(thing, build):
    """A modifier of geometry nodes. @param build  function of the tree, the group's input and its output"""
    group = bpy.data.node_groups.new("Made", "GeometryNodeTree")
    group.inputs.new("NodeSocketGeometry", "Geometry")
    group.outputs.new("NodeSocketGeometry", "Geometry")
    ends = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
    build(group, *ends)
    thing.modifiers.new("Made", "NODES").node_group = group


# Volumes and fog that modifiers make.


def volume_cube_of_noise(b):
    thing = b.link(bpy.data.volumes.new("Volume"), "Volume")
    thing.data.materials.append(scattering("S", "density", 4, 0.8))
    thing.data.render.space = "WORLD"

    def build(group, _, out):
        cube, noise, ramp = (group.nodes.new(kind) for kind in ("GeometryNodeVolumeCube", "ShaderNodeTexNoise", "ShaderNodeMapRange"))
        for name in ("Resolution X", "Resolution Y", "Resolution Z"):
            cube.inputs[name].default_value = 40
        noise.inputs["Scale"].default_value = 2
        for name, value in (("From Min", 0.45), ("From Max", 0.6)):
            ramp.inputs[name].default_value = value
        group.links.new(noise.outputs["Fac"], ramp.inputs["Value"])
        group.links.new(ramp.outputs[0], cube.inputs["Density"])
        group.links.new(cube.outputs[0], out.inputs[0])

    made_by_nodes(thing, build)


def fog_with_a_hole(b):
    """A boolean modifier."""
    box = b.mesh("cube", "Box", fog(), size=1.6)
    ball = b.mesh("ico_sphere", "Ball", subdivisions=4, radius=1)
    ball.hide_render = True
    cut = box.modifiers.new("Cut", "BOOLEAN")
    cut.object, cut.operation = ball, "DIFFERENCE"
    box.rotation_euler = (0.3, 0.2, 0.5)


def fog_of_shape_keys(b):
    ball = b.mesh("ico_sphere", "Ball", fog(), subdivisions=4, radius=1)
    ball.shape_key_add(name="Basis")
    key = ball.shape_key_add(name="Wide")
    for vertex in key.data:
        vertex.co.x *= 1 + max(vertex.co.z, 0)
    for frame in (1, 11):
        key.value = (frame - 1) / 10
        key.keyframe_insert("value", frame=frame)
    b.scene.frame_set(8)


def fog_in_an_array(b):
    box = b.mesh("cube", "Box", fog(2), size=0.6, location=(-1.2, 0, 0))
    array = box.modifiers.new("Array", "ARRAY")
    array.count, array.relative_offset_displace = 4, (1.4, 0, 0.2)


def fog_in_letters(b):
    text = bpy.data.curves.new("Text", "FONT")
    text.body, text.extrude, text.align_x, text.size = "vol", 0.3, "CENTER", 1.6
    thing = b.link(text, "Text", (0, 0, -0.3))
    thing.rotation_euler = (1.3, 0, 0.2)
    text.materials.append(fog(2))


# How things are put together.


def sun_of_a_strip(b):
    """Whose rotation an NLA strip animates."""
    fire(b)
    grey(b)
    lamp = sun(b)
    lamp.rotation_mode = "XYZ"
    for frame, angle in ((1, 0.1), (21, 1.1)):
        lamp.rotation_euler = (angle, 0.2, 0)
        lamp.keyframe_insert("rotation_euler", frame=frame)
    action = lamp.animation_data.action
    lamp.animation_data.action = None
    strip = lamp.animation_data.nla_tracks.new().strips.new("Strip", 11, action)
    strip.scale = 2
    b.scene.frame_set(31)


def overridden_from_a_library(b):
    """A collection of another file, one object of which is moved and has another material here."""
    smoke, box = fire(b, "Asset smoke"), b.mesh("cube", "Asset box", diffuse("Asset", (0.7, 0.2, 0.1)), size=0.8)
    collection = bpy.data.collections.new("Asset")
    for thing in (smoke, box):
        b.scene.collection.objects.unlink(thing)
        collection.objects.link(thing)
    path = os.path.join(b.folder, "asset.blend")
    bpy.data.libraries.write(path, {collection}, fake_user=True)
    for data in (smoke.data, box.data, collection):
        bpy.data.batch_remove([data])
    with bpy.data.libraries.load(path, link=True) as (_, here):
        here.collections = ["Asset"]
    linked = here.collections[0]
    b.scene.collection.children.link(linked)
    own = linked.override_hierarchy_create(b.scene, bpy.context.view_layer)
    for thing in own.all_objects:
        if thing.type == "MESH":
            thing.location = (1, 0, 0.3)
        else:
            thing.scale = (0.8, 0.8, 1.2)
    grey(b)


def materials_of_objects(b):
    """One mesh, whose slot's material each object has for itself; one of them is fog."""
    first = b.mesh("cube", "First", diffuse("First", (0.8, 0.2, 0.1)), size=0.8, location=(-1.2, 0, 0))
    for i, material in enumerate((diffuse("Second", (0.1, 0.3, 0.8)), fog(3))):
        other = b.link(first.data, f"Other {i}", (1.2 * i, 0, 0))
        other.material_slots[0].link = "OBJECT"
        other.material_slots[0].material = material
    grey(b)
    sun(b)


def sheared_by_a_parent(b):
    mover = b.link(None, "Mover")
    mover.scale, mover.rotation_euler = (1.6, 0.7, 1), (0, 0.4, 0)
    thing = fire(b, location=(-0.6, -1, -0.7))
    thing.parent, thing.rotation_euler = mover, (0.4, 0.3, 0.6)


def second_of_two_layers(b):
    """Of which one collection is left out, one a holdout and one seen indirectly; over a transparent film."""
    things = {"Kept": fire(b, "Kept"), "Away": fire(b, "Away", location=(0.2, -1, -0.7)), "Hole": b.mesh("cube", "Hole", diffuse("Hole", (0.5, 0.5, 0.5)), size=0.7)}
    things["Unseen"] = b.mesh("cube", "Unseen", diffuse("Unseen", (0.9, 0.1, 0.1)), size=1.5, location=(-1.6, 0, 0))
    things["Hole"].location = (0.3, -1.2, 0)
    grey(b)
    for name, thing in things.items():
        collection = bpy.data.collections.new(name)
        b.scene.collection.children.link(collection)
        for owner in thing.users_collection:
            owner.objects.unlink(thing)
        collection.objects.link(thing)
    layer = bpy.context.view_layer
    children = layer.layer_collection.children
    children["Away"].exclude, children["Hole"].holdout, children["Unseen"].indirect_only = True, True, True
    b.scene.render.film_transparent = True
    sun(b)


# How it is lit and exposed.


def exposed(b):
    fire(b)
    grey(b)
    b.scene.cycles.film_exposure = 1.7
    b.scene.view_settings.exposure = 2  # of the screen alone


def warm_lamp(b):
    fire(b)
    grey(b)
    lamp = b.light("AREA", "Warm", (1, -2, 2), look_at=(0, 0, 0), energy=200, size=0.5).data
    lamp.use_nodes = True
    tree = lamp.node_tree
    colour = tree.nodes.new("ShaderNodeBlackbody")
    colour.inputs[0].default_value = 2500
    tree.links.new(colour.outputs[0], tree.nodes["Emission"].inputs["Color"])
    tree.nodes["Emission"].inputs["Strength"].default_value = 1.5


def _under(b, kind, **settings):
    tree = b.scene.world.node_tree
    sky = tree.nodes.new("ShaderNodeTexSky")
    sky.sky_type = kind
    for key, value in settings.items():
        setattr(sky, key, value)
    tree.links.new(sky.outputs[0], tree.nodes["Background"].inputs["Color"])
    tree.nodes["Background"].inputs["Strength"].default_value = 0.2
    fire(b)
    grey(b, 40)
    b.scene.camera.location, b.scene.camera.rotation_mode = (0, -4, 5), "XYZ"
    b.scene.camera.rotation_euler = (0.7, 0, 0)


def under_preetham(b):
    _under(b, "PREETHAM", sun_direction=(0.5, -0.3, 0.7), turbidity=3)


def under_hosek_wilkie(b):
    _under(b, "HOSEK_WILKIE", sun_direction=(0.5, -0.3, 0.7), turbidity=3, ground_albedo=0.3)


def under_nishita(b):
    _under(b, "NISHITA", sun_elevation=math.radians(40), sun_rotation=0.6)


def world_fog_on_a_transparent_film(b):
    tree = b.scene.world.node_tree
    haze = tree.nodes.new("ShaderNodeVolumeScatter")
    haze.inputs["Density"].default_value = 0.1
    tree.nodes["Background"].inputs["Strength"].default_value = 0  # of which Cycles lets 3 % through this film
    tree.links.new(haze.outputs[0], tree.nodes["World Output"].inputs["Volume"])
    grey(b)
    b.light("POINT", "Point", (2, 2, 5), energy=4000, shadow_soft_size=0)
    b.scene.render.film_transparent = True


SETUPS = (
    volume_cube_of_noise, fog_with_a_hole, fog_of_shape_keys, fog_in_an_array, fog_in_letters, sun_of_a_strip,
    overridden_from_a_library, materials_of_objects, sheared_by_a_parent, second_of_two_layers, exposed, warm_lamp,
    under_preetham, under_hosek_wilkie, under_nishita, world_fog_on_a_transparent_film,
)  # fmt: skip


class Setups(Comparison):
    def test_means_are_cycles(self):
        for kind in SETUPS:
            with self.subTest(kind.__name__):
                self.compare(kind, WITHIN_OF.get(kind.__name__, WITHIN))


if __name__ == "__main__":
    scenes.run_tests(sys.modules[__name__])
