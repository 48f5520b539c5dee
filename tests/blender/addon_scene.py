"""Scenes for tests, built inside Blender: smoke over a floor, a lamp, a sky. And what tests of the add-on share."""

import os
import sys
import tempfile

import addon_utils
import bpy

SOURCE = os.environ["BRUME_SOURCE"]
SMOKE = os.path.join(SOURCE, "data", "volumes", "smoke.vdb")
SMOKE_GRID = "density_noise"

sys.path.insert(0, os.path.join(SOURCE, "apps", "blender"))
from brume_blender import exr  # noqa: E402, F401


def new_scene(engine="BRUME", width=96, height=72):
    """An empty file with the add-on and Cycles enabled."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    addon_utils.enable("brume_blender", default_set=True)
    addon_utils.enable("cycles", default_set=True)
    scene = bpy.context.scene
    scene.render.engine = engine
    scene.render.resolution_x, scene.render.resolution_y = width, height
    scene.render.image_settings.file_format = "OPEN_EXR_MULTILAYER"
    scene.render.image_settings.color_depth = "32"
    scene.render.image_settings.exr_codec = "ZIP"
    scene.brume.samples = 4
    if hasattr(scene, "cycles"):
        scene.cycles.use_denoising = False
    return scene


def link(name, data, location=(0, 0, 0), rotation=(0, 0, 0)):
    thing = bpy.data.objects.new(name, data)
    thing.location, thing.rotation_euler = location, rotation
    bpy.context.scene.collection.objects.link(thing)
    return thing


def add_camera(location=(0, -7, 1.5), rotation=(1.5707963, 0, 0)):
    camera = link("Camera", bpy.data.cameras.new("Camera"), location, rotation)
    bpy.context.scene.camera = camera
    return camera


def add_smoke(path=SMOKE, grid=SMOKE_GRID, density=3.0):
    volume = bpy.data.volumes.new("Smoke")
    volume.filepath = path
    material = bpy.data.materials.new("Smoke")
    material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    shader, output = nodes.new("ShaderNodeVolumePrincipled"), nodes.new("ShaderNodeOutputMaterial")
    shader.inputs["Density Attribute"].default_value = grid
    shader.inputs["Density"].default_value = density
    shader.inputs["Color"].default_value = (0.8, 0.8, 0.8, 1)
    material.node_tree.links.new(shader.outputs[0], output.inputs["Volume"])
    volume.materials.append(material)
    return link("Smoke", volume)


def add_floor(color=(0.5, 0.4, 0.3, 1)):
    bpy.ops.mesh.primitive_plane_add(size=20, location=(0, 0, -0.2))
    floor = bpy.context.object
    floor.name = "Floor"
    material = bpy.data.materials.new("Floor")
    material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    shader, output = nodes.new("ShaderNodeBsdfDiffuse"), nodes.new("ShaderNodeOutputMaterial")
    shader.inputs["Color"].default_value = color
    material.node_tree.links.new(shader.outputs[0], output.inputs["Surface"])
    floor.data.materials.append(material)
    return floor


def add_lamp(location=(2, -2, 4), watts=800, radius=0.1):
    light = bpy.data.lights.new("Lamp", "POINT")
    light.energy, light.shadow_soft_size = watts, radius
    return link("Lamp", light, location)


def add_sky(color=(0.3, 0.4, 0.6, 1)):
    world = bpy.data.worlds.new("World")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = color
    bpy.context.scene.world = world


def smoke_scene(engine="BRUME", width=96, height=72, floor=True, path=SMOKE, grid=SMOKE_GRID):
    scene = new_scene(engine, width, height)
    add_camera()
    add_smoke(path, grid)
    add_lamp()
    add_sky()
    if floor:
        add_floor()
    return scene


def all_passes(view_layer):
    for name in ("z", "position", "normal", "diffuse_direct", "diffuse_indirect", "diffuse_color", "emit", "environment"):
        setattr(view_layer, f"use_pass_{name}", True)
    view_layer.brume.use_pass_volume_direct = view_layer.brume.use_pass_volume_indirect = True


def render(path, scene=None):
    """Renders the current frame into a multilayer EXR of 32 bits and reads it. @throws RuntimeError as Blender does"""
    scene = scene or bpy.context.scene
    scene.render.filepath = path
    bpy.ops.render.render(write_still=True)
    return exr.read(path)


def leftovers():
    """Temporary folders of renders."""
    return [name for name in os.listdir(bpy.app.tempdir) if name.startswith("brume_")]


def run_tests(module):
    """Runs the unit tests of a module and ends Blender with the result."""
    import unittest

    names = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []
    loader = unittest.TestLoader()
    suite = loader.loadTestsFromNames(names, module) if names else loader.loadTestsFromModule(module)
    result = unittest.TextTestRunner(stream=sys.stdout, verbosity=2).run(suite)
    sys.stdout.flush()
    sys.exit(0 if result.wasSuccessful() and result.testsRun > 0 else 1)


def folder():
    """A folder that is removed with the object: folder().name."""
    return tempfile.TemporaryDirectory(prefix="brume_test_")
