"""Parts of Blender scenes, for the tests: cameras, meshes, materials, volumes, lamps, and how Cycles renders them plainly."""

import math
import os

import bpy
import numpy as np
from mathutils import Matrix, Vector

BOUNCES = 64


class Builder:
    """An empty scene that grows. @param data  the project's folder data/"""

    def __init__(self, data, width=120, height=90):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        self.data, self.scene = data, bpy.context.scene
        render = self.scene.render
        render.engine = "CYCLES"
        render.resolution_x, render.resolution_y, render.resolution_percentage = width, height, 100
        self.scene.frame_set(1)
        self.world([0, 0, 0])

    # ---- things

    def link(self, data, name, location=(0, 0, 0)):
        thing = bpy.data.objects.new(name, data)
        thing.location = location
        self.scene.collection.objects.link(thing)
        return thing

    def camera(self, location, look_at, angle=30):
        data = bpy.data.cameras.new("Camera")
        camera = self.link(data, "Camera", location)
        data.sensor_fit, data.clip_start = "HORIZONTAL", 0.001
        data.angle = math.radians(angle)
        aim(camera, look_at)
        self.scene.camera = camera
        return camera

    def world(self, colour):
        world = bpy.data.worlds.new("World")
        world.use_nodes = True
        world.node_tree.nodes["Background"].inputs["Color"].default_value = (*colour, 1)
        self.scene.world = world
        return world

    def light(self, kind, name, location=(0, 0, 0), look_at=None, **settings):
        light = bpy.data.lights.new(name, kind)
        for key, value in settings.items():
            setattr(light, key, value)
        thing = self.link(light, name, location)
        if look_at is not None:
            aim(thing, look_at)
        return thing

    def mesh(self, operator, name, material=None, smooth=False, **settings):
        getattr(bpy.ops.mesh, f"primitive_{operator}_add")(**settings)
        thing = bpy.context.object
        thing.name = name
        if smooth:
            bpy.ops.object.shade_smooth()
        if material is not None:
            thing.data.materials.append(material)
        return thing

    def floor(self, material, size=20):
        return self.mesh("plane", "Floor", material, size=size)

    def volume(self, file, name, material, location=(0, 0, 0)):
        data = bpy.data.volumes.new(name)
        data.filepath = os.path.join(self.data, "volumes", file)
        data.render.space, data.render.step_size, data.render.precision = "WORLD", 0.0, "FULL"
        if material is not None:
            data.materials.append(material)
        return self.link(data, name, location)

    def collection(self, name, things):
        """An instancer of a collection with these things, which leave the scene."""
        collection = bpy.data.collections.new(name)
        for thing in things:
            self.scene.collection.objects.unlink(thing)
            collection.objects.link(thing)

        def instance(location, scale=1.0, turn=0.0):
            empty = self.link(None, name, location)
            empty.instance_type, empty.instance_collection = "COLLECTION", collection
            empty.scale, empty.rotation_euler = [scale] * 3, (0, 0, turn)
            return empty

        return instance

    # ---- rendering

    def plain(self, samples):
        """Cycles without what makes it quicker than exact."""
        scene, cycles = self.scene, self.scene.cycles
        scene.render.threads_mode, scene.render.threads = "FIXED", 2
        cycles.samples, cycles.use_adaptive_sampling, cycles.use_denoising = samples, False, False
        for kind in ("max", "diffuse", "glossy", "transmission", "volume"):
            setattr(cycles, kind + "_bounces", BOUNCES)
        cycles.transparent_max_bounces = BOUNCES
        cycles.sample_clamp_direct = cycles.sample_clamp_indirect = cycles.light_sampling_threshold = cycles.blur_glossy = 0
        cycles.pixel_filter_type, cycles.filter_width = "BOX", 1.0
        cycles.volume_step_rate, cycles.volume_max_steps = 1.0, 65536  # a voxel: 0.06 % too bright
        cycles.use_auto_tile = False
        if hasattr(cycles, "use_light_tree"):
            cycles.use_light_tree = False
        image = scene.render.image_settings
        image.file_format, image.color_depth, image.color_mode = "OPEN_EXR_MULTILAYER", "32", "RGBA"
        for material in bpy.data.materials:
            material.cycles.volume_sampling = "MULTIPLE_IMPORTANCE"

    def render(self, path, seed):
        self.scene.cycles.seed = seed
        self.scene.render.filepath = path
        bpy.ops.render.render(write_still=True)


def aim(thing, look_at):
    thing.rotation_mode = "QUATERNION"
    thing.rotation_quaternion = (Vector(look_at) - thing.location).to_track_quat("-Z", "Y")


class Shader:
    """A material's nodes, from an empty tree."""

    def __init__(self, name):
        self.material = bpy.data.materials.new(name)
        self.material.use_nodes = True
        self.tree = self.material.node_tree
        self.tree.nodes.clear()
        self.output = self.tree.nodes.new("ShaderNodeOutputMaterial")

    def node(self, kind, operation=None, **inputs):
        """A node, with numbers, colours or outputs for inputs: by name, or _0, _1 by place."""
        node = self.tree.nodes.new("ShaderNode" + kind)
        if operation:
            node.operation = operation
        for name, value in inputs.items():
            socket = node.inputs[int(name[1:])] if name[0] == "_" else node.inputs[name.replace("_", " ")]
            self.put(socket, value)
        return node

    def put(self, socket, value):
        if isinstance(value, bpy.types.NodeSocket):
            self.tree.links.new(value, socket)
        elif isinstance(value, bpy.types.Node):
            self.tree.links.new(value.outputs[0], socket)
        elif hasattr(value, "__len__"):
            socket.default_value = (*value, 1) if socket.type == "RGBA" and len(value) == 3 else value
        else:
            socket.default_value = value

    def attribute(self, name):
        node = self.tree.nodes.new("ShaderNodeAttribute")
        node.attribute_name = name
        return node.outputs["Fac"]

    def surface(self, node):
        self.put(self.output.inputs["Surface"], node)
        return self.material

    def volume(self, node):
        self.put(self.output.inputs["Volume"], node)
        return self.material


def diffuse(name, colour):
    s = Shader(name)
    return s.surface(s.node("BsdfDiffuse", Color=colour))


def scattering(name, grid, sigma_t, albedo, g=0.0):
    """A medium of one albedo: density = sigma_t * grid."""
    s = Shader(name)
    density = s.node("Math", "MULTIPLY", _0=s.attribute(grid), _1=sigma_t)
    scatter = s.node("VolumeScatter", Color=[albedo] * 3, Density=density, Anisotropy=g)
    absorption = s.node("VolumeAbsorption", Color=[albedo] * 3, Density=density)
    return s.volume(s.node("AddShader", _0=scatter, _1=absorption))


def image(name, pixels, folder, colour_space="sRGB"):
    """A picture on disk: rows of RGB in [0, 1], the top row first."""
    pixels = np.asarray(pixels, np.float32)
    height, width = pixels.shape[:2]
    made = bpy.data.images.new(name, width, height)
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :3] = pixels[::-1]
    made.pixels.foreach_set(rgba.ravel())
    made.filepath_raw, made.file_format = os.path.join(folder, name + ".png"), "PNG"
    made.save()
    loaded = bpy.data.images.load(made.filepath_raw)
    loaded.colorspace_settings.name = colour_space
    return loaded


def placed(location, scale=(1, 1, 1), turn=0.0):
    return Matrix.Translation(location) @ Matrix.Rotation(turn, 4, "Z") @ Matrix.Diagonal((*scale, 1))
