# Renders a scene file of brume in Blender's Cycles, for bench/against_cycles.sh:
#
#   blender -b --factory-startup --python bench/cycles_scene.py -- SCENE.toml OUT.exr SPP SEED
#
# Takes what the scenes of bench/scenes/general use: a pinhole camera, an even sky, suns and sphere lamps, density grids
# of any extinction and albedo with one Henyey-Greenstein lobe, black bodies in grey ones, diffuse and metal meshes. Anything else ends it with an
# error. Grids of Cycles lie half a voxel beside brume's.
import math
import os
import resource
import sys
import time
import tomllib

import bpy
from mathutils import Matrix, Vector

BOUNCES = 64
scene_file, out, spp, seed = sys.argv[sys.argv.index("--") + 1:]
folder = os.path.dirname(os.path.abspath(scene_file))
with open(scene_file, "rb") as file:
    toml = tomllib.load(file)


def known(table, what, *keys):
    unknown = set(table) - set(keys)
    if unknown:
        sys.exit(f"{scene_file}: this comparison has no {what} {', '.join(sorted(unknown))}")


def rgb(value):
    return list(value) if isinstance(value, list) else [value] * 3


def link(thing, name, matrix=None):
    it = bpy.data.objects.new(name, thing)
    bpy.context.scene.collection.objects.link(it)
    if matrix:
        it.matrix_world = Matrix(matrix)
    return it


def turn(it, towards, axis):
    it.rotation_mode = "QUATERNION"
    it.rotation_quaternion = Vector(towards).to_track_quat(axis, "Y")


def material(name):
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    made.node_tree.nodes.clear()
    return made, made.node_tree, made.node_tree.nodes.new("ShaderNodeOutputMaterial")


def add_volume(v):
    known(v, "volume key", "file", "grid", "sigma_t", "albedo", "g", "object_to_world", "temperature_grid", "temperature_scale",
          "blackbody_intensity", "blackbody_law")
    volume = bpy.data.volumes.new("volume")
    volume.filepath = os.path.join(folder, v["file"])
    volume.render.space, volume.render.step_size, volume.render.precision = "WORLD", 0.0, "FULL"
    link(volume, "volume", v.get("object_to_world"))
    made, tree, output = material("medium")
    volume.materials.append(made)
    made.cycles.volume_sampling = "MULTIPLE_IMPORTANCE"
    if "blackbody_intensity" in v:
        return add_fire(v, tree, output)
    node = tree.nodes.new
    grid, scale, add = node("ShaderNodeAttribute"), node("ShaderNodeMath"), node("ShaderNodeAddShader")
    scatter, absorption = node("ShaderNodeVolumeScatter"), node("ShaderNodeVolumeAbsorption")
    sigma_t, albedo = rgb(v["sigma_t"]), rgb(v.get("albedo", 0.9))
    largest = max(sigma_t)
    # Scatter: Color x Density. Absorption: (1 - Color) x Density.
    scatter.inputs["Color"].default_value = [a * s / largest for a, s in zip(albedo, sigma_t)] + [1]
    absorption.inputs["Color"].default_value = [1 - (1 - a) * s / largest for a, s in zip(albedo, sigma_t)] + [1]
    scatter.inputs["Anisotropy"].default_value = v.get("g", 0.0)
    grid.attribute_name = v.get("grid", "density")
    scale.operation = "MULTIPLY"
    scale.inputs[1].default_value = largest
    tree.links.new(grid.outputs["Fac"], scale.inputs[0])
    for part, slot in ((scatter, 0), (absorption, 1)):
        tree.links.new(scale.outputs[0], part.inputs["Density"])
        tree.links.new(part.outputs[0], add.inputs[slot])
    tree.links.new(add.outputs[0], output.inputs["Volume"])


def add_fire(v, tree, output):
    if v["temperature_grid"] != "auto" or v.get("blackbody_law") != "stefan_boltzmann" or isinstance(v["sigma_t"], list):
        sys.exit(f'{scene_file}: this comparison has fire in grey smoke alone, with temperature_grid = "auto", '
                 'blackbody_law = "stefan_boltzmann"')
    shader = tree.nodes.new("ShaderNodeVolumePrincipled")
    inputs = shader.inputs
    inputs["Color"].default_value = rgb(v["albedo"]) + [1]
    inputs["Absorption Color"].default_value = [0, 0, 0, 1]
    inputs["Anisotropy"].default_value = v.get("g", 0.0)
    inputs["Blackbody Intensity"].default_value = v["blackbody_intensity"]
    inputs["Density Attribute"].default_value = inputs["Temperature Attribute"].default_value = ""
    for name, factor, slot in ((v.get("grid", "density"), v["sigma_t"], "Density"),
                               ("temperature", v["temperature_scale"], "Temperature")):
        grid, scale = tree.nodes.new("ShaderNodeAttribute"), tree.nodes.new("ShaderNodeMath")
        grid.attribute_name, scale.operation = name, "MULTIPLY"
        scale.inputs[1].default_value = factor
        tree.links.new(grid.outputs["Fac"], scale.inputs[0])
        tree.links.new(scale.outputs[0], inputs[slot])
    tree.links.new(shader.outputs[0], output.inputs["Volume"])


def add_light(l):
    known(l, "light key", "type", "direction", "irradiance", "angular_diameter", "position", "radius", "radiance")
    colour = rgb(l["irradiance" if l["type"] == "sun" else "radiance"])
    light = bpy.data.lights.new("light", {"sun": "SUN", "sphere": "POINT"}[l["type"]])
    light.color = [c / max(colour) for c in colour]
    it = link(light, "light")
    if l["type"] == "sun":
        light.energy, light.angle = max(colour), math.radians(l.get("angular_diameter", 0.53))
        turn(it, l["direction"], "Z")
    else:
        light.shadow_soft_size = l["radius"]
        light.energy = max(colour) * 4 * math.pi**2 * l["radius"] ** 2
        it.location = l["position"]


def add_surface(s):
    known(s, "surface key", "file", "material", "albedo", "roughness", "object_to_world")
    bpy.ops.wm.obj_import(filepath=os.path.join(folder, s["file"]), forward_axis="Y", up_axis="Z")
    it = bpy.context.selected_objects[0]
    if "object_to_world" in s:
        it.matrix_world = Matrix(s["object_to_world"])
    made, tree, output = material("surface")
    metal = s.get("material", "diffuse") == "conductor"
    bsdf = tree.nodes.new("ShaderNodeBsdfGlossy" if metal else "ShaderNodeBsdfDiffuse")
    bsdf.inputs["Color"].default_value = rgb(s["albedo"]) + [1]
    if metal:
        bsdf.distribution = "GGX"
        bsdf.inputs["Roughness"].default_value = s.get("roughness", 0.0)
    tree.links.new(bsdf.outputs[0], output.inputs["Surface"])
    it.data.materials.clear()
    it.data.materials.append(made)


bpy.ops.wm.read_factory_settings(use_empty=True)
known(toml, "table", "name", "camera", "film", "environment", "volumes", "lights", "surfaces")
known(toml["camera"], "camera key", "position", "look_at", "fov")
known(toml["environment"], "environment key", "radiance")
scene = bpy.context.scene
scene.render.engine = "CYCLES"
scene.world = bpy.data.worlds.new("sky")
scene.world.use_nodes = True
scene.world.node_tree.nodes["Background"].inputs[0].default_value = rgb(toml["environment"]["radiance"]) + [1]
for entry in toml.get("volumes", []):
    add_volume(entry)
for entry in toml.get("lights", []):
    add_light(entry)
for entry in toml.get("surfaces", []):
    add_surface(entry)
lens = bpy.data.cameras.new("camera")
lens.sensor_fit, lens.angle, lens.clip_start = "HORIZONTAL", math.radians(toml["camera"]["fov"]), 0.001
scene.camera = link(lens, "camera")
scene.camera.location = toml["camera"]["position"]
turn(scene.camera, Vector(toml["camera"]["look_at"]) - Vector(toml["camera"]["position"]), "-Z")

render, cycles = scene.render, scene.cycles
render.resolution_x, render.resolution_y = toml["film"]["width"], toml["film"]["height"]
render.threads_mode, render.threads = "FIXED", 2
cycles.samples, cycles.seed, cycles.use_adaptive_sampling = int(spp), int(seed), False
cycles.use_denoising = False
cycles.max_bounces = cycles.volume_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = BOUNCES
cycles.sample_clamp_indirect = cycles.light_sampling_threshold = cycles.blur_glossy = 0
cycles.pixel_filter_type, cycles.filter_width, cycles.use_auto_tile = "BOX", 1.0, False
render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR_MULTILAYER", "32"
render.filepath = os.path.abspath(out)


def processor():
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


wall, before = time.time(), processor()
bpy.ops.render.render(write_still=True)
print(f"RENDERED seconds {time.time() - wall:.2f} cpu {processor() - before:.2f}", flush=True)
