"""More kinds of scenes that artists build, of how they put them together: instances, cut-outs, view layers, libraries, cameras,
motion. F12 in brume against Cycles: the mean within 1 %; or what is said of them. Runs inside Blender."""

import os
import re
import sys

import bpy
import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import addon_scene as scenes  # noqa: E402
from brume_blender.translate import CannotTranslate  # noqa: E402
from builder import Shader, aim, diffuse, scattering  # noqa: E402
from comparison import Comparison  # noqa: E402


def fire(b, name="Volume", material=None, location=(-1, -1, -0.7)):
    return b.volume("fire.vdb", name, material or scattering("S", "density", 15, 0.9), location)


def sun(b, energy=3, direction=(0.5, 0.4, -0.6)):
    b.light("SUN", "Sun", look_at=direction, energy=energy)


def grey(b, size=8, name="Floor"):
    floor = b.mesh("plane", name, diffuse(name, (0.5, 0.5, 0.5)), size=size)
    floor.location.z = -0.7
    return floor


# Instances.


def twenty_of_a_collection(b):
    puff = fire(b, location=(-1, -1, 0))
    instance = b.collection("Puffs", [puff])
    random = np.random.default_rng(1)
    for i in range(20):
        empty = instance((*random.uniform((-2, -1, -1), (2, 2, 1)),), 1.0, random.uniform(0, 6))
        empty.scale = random.uniform(0.2, 0.7, 3)


def scattered_by_nodes(b):
    scatter(b, fire(b), 6, 5, (3.5, 3.0))


def scatter(b, volume, across, along, size):
    """Instances on the points of a grid, of other sizes and turns each."""
    volume.hide_render = True
    group = bpy.data.node_groups.new("Scatter", "GeometryNodeTree")
    group.outputs.new("NodeSocketGeometry", "Geometry")
    nodes, add = group.nodes, group.links.new
    grid, place = nodes.new("GeometryNodeMeshGrid"), nodes.new("GeometryNodeInstanceOnPoints")
    for name, value in (("Size X", size[0]), ("Size Y", size[1]), ("Vertices X", across), ("Vertices Y", along)):
        grid.inputs[name].default_value = value
    info = nodes.new("GeometryNodeObjectInfo")
    info.inputs["Object"].default_value, info.inputs["As Instance"].default_value = volume, True
    sizes, turns = nodes.new("FunctionNodeRandomValue"), nodes.new("FunctionNodeRandomValue")
    for node, lo, hi in ((sizes, (0.2, 0.2, 0.2), (0.6, 0.4, 0.6)), (turns, (0, 0, 0), (0.4, 0.4, 6))):
        node.data_type = "FLOAT_VECTOR"
        node.inputs[0].default_value, node.inputs[1].default_value = lo, hi
    add(grid.outputs["Mesh"], place.inputs["Points"])
    add(info.outputs["Geometry"], place.inputs["Instance"])
    add(sizes.outputs[0], place.inputs["Scale"])
    add(turns.outputs[0], place.inputs["Rotation"])
    add(place.outputs[0], nodes.new("NodeGroupOutput").inputs[0])
    b.link(bpy.data.meshes.new("Host"), "Host").modifiers.new("Scatter", "NODES").node_group = group


def duplicates_of_one(b):
    first = fire(b, location=(-1.5, -1, -0.5))
    for i in range(1, 12):
        other = b.link(first.data, f"Volume {i}", (0.35 * i - 2.4, 0.25 * (i % 4) - 1, 0.3 * (i % 3) - 0.8))
        other.scale, other.rotation_euler.z = (-0.5 if i % 2 else 0.5, 0.4, 0.6), i


def on_vertices(b):
    host = b.mesh("ico_sphere", "Host", subdivisions=2, radius=1.6)
    puff = fire(b, location=(0, 0, 0))
    puff.parent, puff.scale = host, (0.3, 0.3, 0.3)
    host.instance_type, host.show_instancer_for_render = "VERTS", False


def by_particles(b):
    puff = fire(b, location=(0, 0, 0))
    puff.scale = (0.5, 0.5, 0.5)
    host = b.mesh("plane", "Host", diffuse("Host", (0.5, 0.4, 0.3)), size=4, location=(0, 0, -0.8))
    host.modifiers.new("Particles", "PARTICLE_SYSTEM")
    settings = host.particle_systems[0].settings
    settings.type, settings.count, settings.render_type = "HAIR", 15, "OBJECT"
    settings.instance_object, settings.particle_size, settings.size_random = puff, 0.5, 0.5
    settings.use_advanced_hair = True


def fog_in_many_boxes(b):
    s = Shader("S")
    box = b.mesh("cube", "Box", s.volume(s.node("VolumePrincipled", Density=1.2)), size=0.5)
    instance = b.collection("Boxes", [box])
    for i in range(12):
        instance((0.7 * (i % 4) - 1.1, 0.7 * (i // 4), 0.2 * i - 1), 0.8, 0.3 * i).scale.x = 0.5 + 0.1 * i


def object_space_instances(b):
    """Density by the object's scale, and places that emit."""
    s = Shader("S")
    glow = s.node("VolumePrincipled", Density=12.0, Emission_Color=(1, 0.4, 0.1), Emission_Strength=s.attribute("flame"))
    thing = fire(b, "Fire", s.volume(glow), (0, 0, 0))
    thing.data.render.space = "OBJECT"
    instance = b.collection("Fires", [thing])
    for i in range(5):
        instance((0.9 * i - 2.4, 0, 0.2 * i - 1), 0.3 + 0.1 * i, 0.4 * i)


# Cut-outs.


def leaf(b):
    """A picture of a leaf with alpha, sRGB."""
    y, x = np.mgrid[0:128, 0:128] / 127.0
    pixels = np.ones((128, 128, 4), np.float32)
    pixels[..., 0], pixels[..., 1], pixels[..., 2] = 0.3 + 0.5 * x, 0.7, 0.3
    pixels[..., 3] = (x - 0.5) ** 2 + 2 * (y - 0.5) ** 2 < 0.2
    made = bpy.data.images.new("leaf", 128, 128, alpha=True)
    made.pixels.foreach_set(pixels.ravel())
    made.filepath_raw, made.file_format = os.path.join(b.folder, "leaf.png"), "PNG"
    made.save()
    return bpy.data.images.load(made.filepath_raw)


def cards(b, material):
    for i in range(8):
        card = b.mesh("plane", f"Card {i}", material, size=1)
        card.location, card.rotation_euler = (0.6 * (i % 4) - 0.9, 0.5 * (i // 4) - 0.4, 0.4 * (i % 3) - 0.3), (1.0 + 0.2 * i, 0.3, 0.5 * i)


def cards_in_fog(b):
    s = Shader("Leaf")
    image = s.node("TexImage")
    image.image = leaf(b)
    shader = s.node("BsdfPrincipled", Base_Color=image.outputs["Color"], Alpha=image.outputs["Alpha"], Specular=0.0, Roughness=0.5)
    cards(b, s.surface(shader))
    s = Shader("Fog")
    b.mesh("cube", "Fog", s.volume(s.node("VolumePrincipled", Density=0.3)), size=4)
    sun(b)


def leaves_that_let_light_through(b):
    s = Shader("Leaf")
    image = s.node("TexImage")
    image.image = leaf(b)
    both = s.node("MixShader", _0=0.4, _1=s.node("BsdfDiffuse", Color=image.outputs["Color"]), _2=s.node("BsdfTranslucent", Color=image.outputs["Color"]))
    cards(b, s.surface(s.node("MixShader", _0=image.outputs["Alpha"], _1=s.node("BsdfTransparent"), _2=both)))
    grey(b)
    sun(b, 5)


def half_clear(b):
    s = Shader("Veil")
    veil = s.surface(s.node("MixShader", _0=0.4, _1=s.node("BsdfTransparent"), _2=s.node("BsdfDiffuse", Color=(0.6, 0.3, 0.2))))
    for i in range(3):
        b.mesh("plane", f"Veil {i}", veil, size=1.6, location=(0.5 * i - 0.5, 0, 0.3 + 0.3 * i), rotation=(0.2 * i, 0.1, 0.3))
    grey(b)
    sun(b)
    fire(b)


def holes_by_a_texture(b):
    s = Shader("Cut")
    ramp = s.node("ValToRGB", Fac=s.node("TexNoise", Scale=3.0).outputs["Fac"])
    ramp.color_ramp.elements[0].position, ramp.color_ramp.elements[1].position = 0.45, 0.55
    cut = s.node("MixShader", _0=ramp.outputs["Color"], _1=s.node("BsdfTransparent"), _2=s.node("BsdfDiffuse", Color=(0.6, 0.5, 0.2)))
    b.mesh("uv_sphere", "Ball", s.surface(cut), radius=1, segments=48, ring_count=24, smooth=True)
    grey(b)
    sun(b)


def two_paints(b):
    s = Shader("Painted")
    mask = s.node("TexChecker", Scale=4.0).outputs["Fac"]
    paints = s.node("MixShader", _0=mask, _1=s.node("BsdfDiffuse", Color=(0.7, 0.2, 0.1)), _2=s.node("BsdfDiffuse", Color=(0.1, 0.3, 0.6)))
    b.mesh("monkey", "Head", s.surface(paints), size=2)
    grey(b)
    sun(b)


def black_glass_of_shadows(b):
    """Transparent, with a colour: what it takes of light is the same for all."""
    s = Shader("Smoked")
    b.mesh("plane", "Pane", s.surface(s.node("BsdfTransparent", Color=(0.5, 0.5, 0.5))), size=2, rotation=(1.2, 0, 0))
    grey(b)
    sun(b)


# View layers and files.


def excluded(b):
    kept, away = fire(b, "Kept"), fire(b, "Away", location=(0.2, -1, -0.7))
    collection = bpy.data.collections.new("Away")
    b.scene.collection.children.link(collection)
    b.scene.collection.objects.unlink(away)
    collection.objects.link(away)
    bpy.context.view_layer.layer_collection.children["Away"].exclude = True
    kept.scale = (0.9, 0.9, 1.1)


def overridden(b):
    fire(b)
    grey(b)
    b.mesh("monkey", "Head", diffuse("Head", (0.8, 0.1, 0.1)), size=1.2)
    bpy.context.view_layer.material_override = diffuse("Clay", (0.6, 0.6, 0.6))


def linked_from_a_library(b):
    """A volume of a library beside the file, its path relative to it."""
    import shutil

    folder = os.path.join(b.folder, "assets")
    os.makedirs(os.path.join(folder, "grids"), exist_ok=True)
    shutil.copy(os.path.join(b.data, "volumes", "fire.vdb"), os.path.join(folder, "grids", "asset.vdb"))
    thing = fire(b, "Asset")
    thing.data.filepath = "//grids/asset.vdb"
    bpy.data.libraries.write(os.path.join(folder, "asset.blend"), {thing}, fake_user=True)
    bpy.data.objects.remove(thing)
    with bpy.data.libraries.load(os.path.join(folder, "asset.blend"), link=True) as (there, here):
        here.objects = ["Asset"]
    b.scene.collection.objects.link(here.objects[0])


def a_region_of_kept_data(b):
    fire(b)
    grey(b)
    render = b.scene.render
    render.use_persistent_data, render.use_border, render.use_crop_to_border = True, True, True
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.2, 0.8, 0.1, 0.7


# Cameras and time.


def upright_sensor(b):
    data = b.scene.camera.data
    data.sensor_fit, data.sensor_width, data.sensor_height, data.lens, data.shift_x = "VERTICAL", 30, 20, 35, 0.1
    b.scene.render.pixel_aspect_x = 1.5
    fire(b)
    grey(b)


def cameras_by_markers(b):
    fire(b)
    grey(b)
    other = b.link(bpy.data.cameras.new("Other"), "Other", (4, -3, 2))
    aim(other, (0, 0, 0))
    for frame, camera in ((1, b.scene.camera), (5, other)):
        marker = b.scene.timeline_markers.new("", frame=frame)
        marker.camera = camera
    b.scene.frame_set(7)


def a_camera_that_moves_in_fog(b):
    s = Shader("Fog")
    b.mesh("cube", "Fog", s.volume(s.node("VolumePrincipled", Density=0.2)), size=6)
    b.mesh("monkey", "Head", diffuse("Head", (0.6, 0.3, 0.1)), size=1.5)
    sun(b)
    camera = b.scene.camera
    camera.location = (0, -2.5, 0.3)
    for frame, x in ((0, -1.0), (2, 1.0)):
        camera.location.x = x
        camera.keyframe_insert("location", frame=frame)
    for curve in camera.animation_data.action.fcurves:
        for key in curve.keyframe_points:
            key.interpolation = "LINEAR"
    b.scene.render.use_motion_blur = True
    b.scene.frame_set(1)


def mirrored_with_a_texture(b):
    s = Shader("S")
    noise = s.node("TexNoise", Vector=s.node("TexCoord").outputs["Object"], Scale=2.0)
    density = s.node("Math", "MULTIPLY", _0=s.attribute("density"), _1=s.node("Math", "MULTIPLY", _0=noise, _1=25.0))
    node = s.node("VolumePrincipled", Density=density)
    node.inputs["Density Attribute"].default_value = ""
    fire(b, "Mirrored", s.volume(node), (1, -1, -0.7)).scale = (-1, 1, 1)


def parented_and_constrained(b):
    mover, turner = b.link(None, "Mover", (0.3, 0.2, 0.1)), b.link(None, "Turner")
    turner.rotation_euler = (0.2, 0.1, 0.7)
    thing = fire(b)
    thing.parent = mover
    mover.scale = (1.1, 0.8, 1)
    thing.constraints.new("COPY_ROTATION").target = turner
    limit = thing.constraints.new("LIMIT_SCALE")
    limit.use_max_x, limit.max_x = True, 0.7


def driven(b):
    material = scattering("S", "density", 1, 0.9)
    fire(b, material=material)
    density = next(node for node in material.node_tree.nodes if node.type == "MATH").inputs[1]
    driver = density.driver_add("default_value").driver
    driver.type, driver.expression = "SCRIPTED", "2 * frame + 3"
    b.scene.frame_set(6)


def domain_of_smoke(b):
    """A fluid simulation of three frames, baked."""
    domain = b.mesh("cube", "Domain", size=2)
    settings = domain.modifiers.new("Fluid", "FLUID")
    settings.fluid_type = "DOMAIN"
    settings = settings.domain_settings
    settings.domain_type, settings.resolution_max, settings.cache_type = "GAS", 24, "ALL"
    settings.cache_directory, settings.cache_frame_start, settings.cache_frame_end = os.path.join(b.folder, "fluid"), 1, 6
    settings.cache_data_format = "OPENVDB"
    source = b.mesh("uv_sphere", "Source", radius=0.4, location=(0, 0, -0.5))
    flow = source.modifiers.new("Fluid", "FLUID")
    flow.fluid_type = "FLOW"
    flow.flow_settings.flow_type, flow.flow_settings.flow_behavior, flow.flow_settings.density = "SMOKE", "INFLOW", 1
    source.hide_render = True
    s = Shader("Smoke")
    domain.data.materials.append(s.volume(s.node("VolumePrincipled", Density=6.0)))
    bpy.context.view_layer.objects.active = domain
    bpy.ops.fluid.bake_all()
    b.scene.frame_set(6)
    sun(b)


# What lights.


def a_screen(b):
    s = Shader("Screen")
    image = s.node("TexImage")
    image.image = leaf(b)
    b.mesh("plane", "Screen", s.surface(s.node("Emission", Color=image.outputs["Color"], Strength=4.0)), size=2, location=(0, 1, 0.3), rotation=(1.4, 0, 0))
    grey(b)
    fire(b)


def cards_of_flames(b):
    s = Shader("Flame")
    image = s.node("TexImage")
    image.image = leaf(b)
    glow = s.node("Emission", Color=image.outputs["Color"], Strength=3.0)
    cards(b, s.surface(s.node("MixShader", _0=image.outputs["Alpha"], _1=s.node("BsdfTransparent"), _2=glow)))
    grey(b)


def veins_that_glow(b):
    s = Shader("Veins")
    ramp = s.node("ValToRGB", Fac=s.node("TexNoise", Scale=3.0).outputs["Fac"])
    ramp.color_ramp.elements[0].position, ramp.color_ramp.elements[1].position = 0.5, 0.6
    both = s.node("AddShader", _0=s.node("BsdfDiffuse", Color=(0.3, 0.2, 0.1)), _1=s.node("Emission", Color=(1, 0.4, 0.1), Strength=ramp.outputs["Color"]))
    b.mesh("monkey", "Head", s.surface(both), size=1.8)
    grey(b)


SHOTS = (
    twenty_of_a_collection, scattered_by_nodes, duplicates_of_one, on_vertices, by_particles, fog_in_many_boxes,
    object_space_instances, cards_in_fog, leaves_that_let_light_through, half_clear, holes_by_a_texture, two_paints,
    black_glass_of_shadows, excluded, overridden, linked_from_a_library, a_region_of_kept_data, upright_sensor,
    cameras_by_markers, a_camera_that_moves_in_fog, mirrored_with_a_texture, parented_and_constrained, driven, domain_of_smoke, a_screen, cards_of_flames, veins_that_glow,
)  # fmt: skip


# What is said.


def hair_beside_smoke(b):
    fire(b)
    head = b.mesh("monkey", "Head", diffuse("Head", (0.5, 0.4, 0.3)), size=1)
    head.modifiers.new("Hair", "PARTICLE_SYSTEM")
    head.particle_systems[0].settings.type = "HAIR"


def only_cameras_see(b):
    s = Shader("Trick")
    seen = s.node("LightPath").outputs["Is Camera Ray"]
    b.mesh("monkey", "Head", s.surface(s.node("MixShader", _0=seen, _1=s.node("BsdfTransparent"), _2=s.node("BsdfDiffuse"))), size=1)


def coloured_pane(b):
    s = Shader("Pane")
    b.mesh("plane", "Pane", s.surface(s.node("BsdfTransparent", Color=(1, 0.5, 0.2))), size=1)


def thin_by_chance(b):
    s = Shader("S")
    by_chance = s.node("Math", "MULTIPLY", _0=s.node("ObjectInfo").outputs["Random"], _1=20.0)
    return fire(b, "Volume", s.volume(s.node("VolumeAbsorption", Density=s.node("Math", "MULTIPLY", _0=s.attribute("density"), _1=by_chance))))


SAID = (
    (hair_beside_smoke, "Head: its hair is left out"),
    (only_cameras_see, "Trick: the material is the same for rays of every kind: as camera rays see it"),
    (coloured_pane, "Pane: the material lets coloured light through, which is grey here"),
    (overridden, "Volume: the volume is left out: its material has no volume shader"),
)  # fmt: skip


class Shots(Comparison):
    def test_means_are_cycles(self):
        for kind in SHOTS:
            with self.subTest(kind.__name__):
                self.compare(kind)

    def test_many_instances_are_one_volume(self):
        for random in (False, True):
            b = self.built(lambda b: scatter(b, thin_by_chance(b) if random else fire(b), 50, 40, (20, 20)))
            text = self.translated(b).text
            self.assertEqual(text.count("[[volumes]]"), 1)
            with open(os.path.join(self.folder, re.search(r'volume = 0\nfile = "(.*)"', text)[1]), "rb") as file:
                header, rows = file.read().split(b"end_header\n", 1)
            self.assertIn(b"element vertex 2000\n", header)
            density = np.frombuffer(rows).reshape(2000, -1)[:, 12]
            self.assertEqual(np.ptp(density) > 0.5, random)

    def test_what_is_left_out_is_said(self):
        for kind, note in SAID:
            with self.subTest(kind.__name__):
                self.assertIn(note, "\n".join(self.translated(self.built(kind)).notes))

    def test_there_is_no_picture_of_a_panorama(self):
        b = self.built(fire)
        b.scene.camera.data.type = "PANO"
        with self.assertRaisesRegex(CannotTranslate, "Camera: brume has no pano camera; it has perspective and orthographic ones"):
            self.translated(b)


if __name__ == "__main__":
    scenes.run_tests(sys.modules[__name__])
