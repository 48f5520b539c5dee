# Artists' scenes for bench/f12.py and docs/blender.md. Writes SCENE.blend, and what it needs beside it:
#
#   blender -b --factory-startup --python bench/f12_scene.py -- SCENE.blend [plume]
#
# plume: smoke over a floor, a ball of metal and one of glass, a sky that is a picture, two lamps. explosion: fire by a ramp and
# as a black body over a floor that it lights. sunbeams: a dusty room with two windows. glass: smoke in a ball of glass. puffs:
# twenty instances with uneven scale under a sun, on a floor with gloss.
import math
import os
import sys

import bpy
import numpy as np

arguments = sys.argv[sys.argv.index("--") + 1 :]
path = os.path.abspath(arguments[0])
folder = os.path.dirname(path)
VOLUMES = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "data", "volumes")
SMOKE = os.path.join(VOLUMES, "smoke.vdb")
SMOKE_GRID = "density_noise"  # over [0.1, 2] x [0, 2] x [0, 3]


def link(name, data, location=(0, 0, 0)):
    thing = bpy.data.objects.new(name, data)
    thing.location = location
    bpy.context.scene.collection.objects.link(thing)
    return thing


def aim(thing, target):
    from mathutils import Vector

    thing.rotation_euler = (Vector(target) - thing.location).to_track_quat("-Z", "Y").to_euler()


def material(name, kind, socket="Surface", **inputs):
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    nodes = made.node_tree.nodes
    nodes.clear()
    shader, output = nodes.new(kind), nodes.new("ShaderNodeOutputMaterial")
    for key, value in inputs.items():
        shader.inputs[key.replace("_", " ")].default_value = value
    made.node_tree.links.new(shader.outputs[0], output.inputs[socket])
    return made


def sky_picture(width=512, height=256):
    """A clear evening: blue above, warm at the horizon, a soft sun, a ground that darkens downwards."""
    v, u = np.mgrid[0:height, 0:width]
    up = np.sin((v + 0.5) / height * math.pi - math.pi / 2)[..., None]  # rows of Blender's images go from the bottom
    around = ((u + 0.5) / width * 2 - 1)[..., None] * math.pi
    high, low = np.array([0.02, 0.09, 0.36]), np.array([1.3, 0.5, 0.2])
    sky = high + (low - high) * np.exp(-9 * np.abs(up))
    colour = np.where(up > 0, sky, low * (0.3 + 0.7 * np.exp(8 * up)))
    sun = np.array([math.cos(0.45) * math.cos(2.4), math.cos(0.45) * math.sin(2.4), math.sin(0.45)])
    level = np.sqrt(1 - up**2)
    cosine = level * (np.cos(around) * sun[0] + np.sin(around) * sun[1]) + up * sun[2]
    colour = colour + np.array([60.0, 48.0, 34.0]) * np.exp((cosine - 1) / 0.004)
    image = bpy.data.images.new("sky", width, height, float_buffer=True)
    pixels = np.concatenate([colour, np.ones((height, width, 1))], axis=-1).astype(np.float32)
    image.pixels.foreach_set(pixels.ravel())
    image.filepath_raw, image.file_format = os.path.join(folder, "sky.exr"), "OPEN_EXR"
    image.save()
    return bpy.data.images.load(image.filepath_raw)


def world():
    made = bpy.data.worlds.new("Evening")
    made.use_nodes = True
    tree = made.node_tree
    texture = tree.nodes.new("ShaderNodeTexEnvironment")
    texture.image = sky_picture()
    tree.links.new(texture.outputs["Color"], tree.nodes["Background"].inputs["Color"])
    tree.nodes["Background"].inputs["Strength"].default_value = 0.45
    bpy.context.scene.world = made


def volume(file, made, name, location, scale=(1, 1, 1)):
    data = bpy.data.volumes.new(name)
    data.filepath = os.path.normpath(os.path.join(VOLUMES, file))
    data.render.space = "WORLD"  # the density does not change with the scale
    data.materials.append(made)
    thing = link(name, data, location)
    thing.scale = scale
    return thing


def smoke(density, **inputs):
    made = material("Smoke", "ShaderNodeVolumePrincipled", "Volume", Density=density, **inputs)
    made.node_tree.nodes["Principled Volume"].inputs["Density Attribute"].default_value = SMOKE_GRID
    return made


def lamp(kind, name, location, target, energy, **settings):
    data = bpy.data.lights.new(name, kind)
    data.energy = energy
    for key, value in settings.items():
        setattr(data, key, value)
    aim(link(name, data, location), target)


def floor(made, size=2000):
    bpy.ops.mesh.primitive_plane_add(size=size, location=(0, 0, 0))
    bpy.context.object.data.materials.append(made)


def sky(colour):
    made = bpy.data.worlds.new("Sky")
    made.use_nodes = True
    made.node_tree.nodes["Background"].inputs["Color"].default_value = (*colour, 1)
    bpy.context.scene.world = made


def plume():
    world()
    made = smoke(22.0, Color=(0.72, 0.72, 0.74, 1), Anisotropy=0.3)
    volume("smoke.vdb", made, "Plume", (-1.35, -0.9, -0.02), (1.25, 1.25, 1.25))
    solids()
    lamps()
    camera((0.0, -8.2, 1.7), (0, 0, 1.6))


def explosion():
    sky((0.01, 0.012, 0.02))
    floor(material("Floor", "ShaderNodeBsdfDiffuse", Color=(0.4, 0.36, 0.33, 1)))
    made = bpy.data.materials.new("Fire")
    made.use_nodes = True
    tree = made.node_tree
    tree.nodes.clear()
    node = tree.nodes.new("ShaderNodeVolumePrincipled")
    for key, value in (("Density", 8.0), ("Color", (0.5, 0.45, 0.4, 1)), ("Blackbody Intensity", 0.02), ("Temperature", 1600.0)):
        node.inputs[key].default_value = value
    flame, ramp = tree.nodes.new("ShaderNodeAttribute"), tree.nodes.new("ShaderNodeValToRGB")
    flame.attribute_name = "flame"
    ramp.color_ramp.elements[0].color, ramp.color_ramp.elements[1].color = (0, 0, 0, 1), (1, 0.45, 0.1, 1)
    ramp.color_ramp.elements[0].position = 0.15
    tree.links.new(flame.outputs["Fac"], ramp.inputs["Fac"])
    tree.links.new(ramp.outputs["Color"], node.inputs["Emission Color"])
    node.inputs["Emission Strength"].default_value = 12.0
    tree.links.new(node.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs["Volume"])
    volume("fire.vdb", made, "Explosion", (-1, -1, 0))
    camera((0, -6.5, 1.5), (0, 0, 1.0))


def box(name, made, lo, hi):
    bpy.ops.mesh.primitive_cube_add(size=1, location=[(a + b) / 2 for a, b in zip(lo, hi)])
    thing = bpy.context.object
    thing.name, thing.scale = name, [b - a for a, b in zip(lo, hi)]
    thing.data.materials.append(made)


def sunbeams():
    sky((0.2, 0.3, 0.5))
    wall = material("Wall", "ShaderNodeBsdfDiffuse", Color=(0.6, 0.55, 0.5, 1))
    for i, (lo, hi) in enumerate((
        ((-3, -4, -0.1), (3, 3, 0)), ((-3, -4, 3), (3, 3, 3.1)), ((-3, 3, 0), (3, 3.1, 3)), ((-3.1, -4, 0), (-3, 3, 3)),
        # The wall with the windows.
        ((3, -4, 0), (3.1, 3, 1)), ((3, -4, 2.2), (3.1, 3, 3)), ((3, -4, 1), (3.1, -0.8, 2.2)), ((3, 0, 1), (3.1, 1, 2.2)), ((3, 1.8, 1), (3.1, 3, 2.2)),
    )):  # fmt: skip
        box(f"Wall {i}", wall, lo, hi)
    box("Dust", material("Dust", "ShaderNodeVolumeScatter", "Volume", Density=0.06, Anisotropy=0.4), (-2.99, -3.99, 0.01), (2.99, 2.99, 2.99))
    lamp("SUN", "Sun", (6, -1, 5), (0, 1, 0.5), 12, angle=0.01)
    camera((-1.6, -3.8, 1.5), (0.6, 1.5, 1.3), 24)


def glass():
    sky((0.5, 0.55, 0.6))
    floor(material("Floor", "ShaderNodeBsdfDiffuse", Color=(0.5, 0.5, 0.5, 1)))
    bpy.ops.mesh.primitive_uv_sphere_add(segments=96, ring_count=48, radius=1.3, location=(0, 0, 1.3))
    bpy.ops.object.shade_smooth()
    bpy.context.object.data.materials.append(material("Glass", "ShaderNodeBsdfGlass", Color=(1, 1, 1, 1), Roughness=0.0, IOR=1.45))
    volume("smoke.vdb", smoke(20.0, Color=(0.8, 0.8, 0.8, 1)), "Smoke", (-0.6, -0.55, 0.55), (0.55, 0.55, 0.5))
    lamp("AREA", "Key", (3, -3, 5), (0, 0, 1), 600, size=2)
    camera((0, -8, 2.2), (0, 0, 1.2))


def puffs():
    sky((0.25, 0.35, 0.55))
    floor(material("Floor", "ShaderNodeBsdfPrincipled", Base_Color=(0.35, 0.3, 0.25, 1), Roughness=0.4))
    made, random = smoke(8.0, Color=(0.85, 0.85, 0.85, 1)), np.random.default_rng(3)
    data = volume("smoke.vdb", made, "Puff", (-2, 4, 0)).data
    for i in range(19):
        thing = link(f"Puff {i}", data, (*random.uniform((-3.5, -2.5), (2.5, 4.5)), 0))
        thing.scale, thing.rotation_euler = random.uniform(0.3, 0.8, 3), (0, 0, random.uniform(0, 6.28))
    lamp("SUN", "Sun", (4, -4, 6), (0, 0, 0), 4, angle=0.05)
    camera((0, -9, 2.6), (0, 0, 0.9))


def solids():
    floor(material("Floor", "ShaderNodeBsdfDiffuse", Color=(0.26, 0.22, 0.2, 1)))
    for name, x, made in (
        ("Metal", -1.45, material("Metal", "ShaderNodeBsdfGlossy", Color=(0.9, 0.72, 0.45, 1), Roughness=0.15)),
        ("Glass", 1.35, material("Glass", "ShaderNodeBsdfGlass", Color=(1, 1, 1, 1), Roughness=0.0, IOR=1.45)),
    ):
        bpy.ops.mesh.primitive_uv_sphere_add(segments=96, ring_count=48, radius=0.6, location=(x, -1.5, 0.601))
        bpy.ops.object.shade_smooth()
        bpy.context.object.name = name
        bpy.context.object.data.materials.append(made)


def lamps():
    lamp("AREA", "Key", (4.4, -0.6, 3.4), (0, 0, 1.4), 1300, size=1.2, color=(1.0, 0.78, 0.52))
    lamp("POINT", "Rim", (-2.9, 1.9, 2.4), (0, 0, 0), 1100, shadow_soft_size=0.4, color=(0.25, 0.5, 1.0))


def camera(location, target, lens=46):
    data = bpy.data.cameras.new("Camera")
    data.lens, data.clip_end = lens, 5000
    scene.camera = link("Camera", data, location)
    aim(scene.camera, target)


bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
scene.view_settings.look = "High Contrast"
scene.render.resolution_x, scene.render.resolution_y = 480, 360
{"plume": plume, "explosion": explosion, "sunbeams": sunbeams, "glass": glass, "puffs": puffs}[(*arguments, "plume")[1]]()
bpy.ops.wm.save_as_mainfile(filepath=path, relative_remap=False)
