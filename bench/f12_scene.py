# An artist's scene for bench/f12.py and docs/blender.md: a plume of smoke over a floor, a ball of metal and one of glass, a
# sky that is a picture, two lamps. Writes SCENE.blend, and the sky beside it:
#
#   blender -b --factory-startup --python bench/f12_scene.py -- SCENE.blend
import math
import os
import sys

import bpy
import numpy as np

path = os.path.abspath(sys.argv[sys.argv.index("--") + 1])
folder = os.path.dirname(path)
SMOKE = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "data", "volumes", "smoke.vdb")
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


def plume():
    volume = bpy.data.volumes.new("Plume")
    volume.filepath = os.path.normpath(SMOKE)
    volume.render.space = "WORLD"  # the density does not change with the scale
    smoke = material("Smoke", "ShaderNodeVolumePrincipled", "Volume", Density=22.0, Color=(0.72, 0.72, 0.74, 1), Anisotropy=0.3)
    smoke.node_tree.nodes["Principled Volume"].inputs["Density Attribute"].default_value = SMOKE_GRID
    volume.materials.append(smoke)
    thing = link("Plume", volume, (-1.35, -0.9, -0.02))
    thing.scale = (1.25, 1.25, 1.25)


def solids():
    bpy.ops.mesh.primitive_plane_add(size=2000, location=(0, 0, 0))
    bpy.context.object.data.materials.append(material("Floor", "ShaderNodeBsdfDiffuse", Color=(0.26, 0.22, 0.2, 1)))
    for name, x, made in (
        ("Metal", -1.45, material("Metal", "ShaderNodeBsdfGlossy", Color=(0.9, 0.72, 0.45, 1), Roughness=0.15)),
        ("Glass", 1.35, material("Glass", "ShaderNodeBsdfGlass", Color=(1, 1, 1, 1), Roughness=0.0, IOR=1.45)),
    ):
        bpy.ops.mesh.primitive_uv_sphere_add(segments=96, ring_count=48, radius=0.6, location=(x, -1.5, 0.601))
        bpy.ops.object.shade_smooth()
        bpy.context.object.name = name
        bpy.context.object.data.materials.append(made)


def lamps():
    key = bpy.data.lights.new("Key", "AREA")
    key.energy, key.size, key.color = 1300, 1.2, (1.0, 0.78, 0.52)
    aim(link("Key", key, (4.4, -0.6, 3.4)), (0, 0, 1.4))
    rim = bpy.data.lights.new("Rim", "POINT")
    rim.energy, rim.shadow_soft_size, rim.color = 1100, 0.4, (0.25, 0.5, 1.0)
    link("Rim", rim, (-2.9, 1.9, 2.4))


def camera(scene):
    data = bpy.data.cameras.new("Camera")
    data.lens, data.clip_end = 46, 5000
    scene.camera = link("Camera", data, (0.0, -8.2, 1.7))
    aim(scene.camera, (0, 0, 1.6))


bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
scene.view_settings.look = "High Contrast"
scene.render.resolution_x, scene.render.resolution_y = 480, 360
world()
plume()
solids()
lamps()
camera(scene)
bpy.ops.wm.save_as_mainfile(filepath=path, relative_remap=False)
