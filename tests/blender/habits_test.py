"""Set-ups that artists have the habit of: slots, attributes of objects, drinks in glasses, gas that glows, what is hidden and what is
missing. F12 in brume against Cycles: the mean within 1 %; or what is said of them. Runs inside Blender."""

import os
import sys

import bpy

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import addon_scene as scenes  # noqa: E402
from builder import Shader, diffuse, scattering  # noqa: E402
from comparison import Comparison  # noqa: E402
from setups_test import fire, fog, grey, made_by_nodes, sun  # noqa: E402


def grids(s, density=1.0, **inputs):
    """Principled Volume, with the attributes that it has from the start."""
    return s.node("VolumePrincipled", Density=density, **inputs)


# Slots and attributes.


def fog_in_the_second_slot(b):
    box = b.mesh("cube", "Box", diffuse("Paint", (0.7, 0.3, 0.1)), size=1.2)
    box.data.materials.append(fog(2))
    for face in box.data.polygons:
        face.material_index = face.index % 2
    grey(b)
    sun(b)


def material_set_by_nodes(b):
    thing = b.link(bpy.data.volumes.new("Volume"), "Volume")
    thing.data.render.space = "WORLD"
    material = scattering("S", "density", 3, 0.8)

    def build(group, _, out):
        cube, put, noise = (group.nodes.new(kind) for kind in ("GeometryNodeVolumeCube", "GeometryNodeSetMaterial", "ShaderNodeTexNoise"))
        group.links.new(noise.outputs["Fac"], cube.inputs["Density"])
        for name in ("Resolution X", "Resolution Y", "Resolution Z"):
            cube.inputs[name].default_value = 16
        put.inputs["Material"].default_value = material
        group.links.new(cube.outputs[0], put.inputs["Geometry"])
        group.links.new(put.outputs[0], out.inputs[0])

    made_by_nodes(thing, build)


def density_of_a_property(b):
    """A custom property of each object, by Attribute's kind Object."""
    s = Shader("S")
    own = s.node("Attribute")
    own.attribute_type, own.attribute_name = "OBJECT", '["thick"]'
    density = s.node("Math", "MULTIPLY", _0=s.attribute("density"), _1=own.outputs["Fac"])
    material = s.volume(s.node("VolumeAbsorption", Density=density))
    for i, thick in enumerate((4.0, 20.0)):
        thing = fire(b, f"Volume {i}", material, (-2 + 1.6 * i, -1, -0.7))
        thing["thick"], thing.scale = thick, (0.8, 0.8, 0.8)


def materials_of_volumes(b):
    """One volume, whose slot's material each object has for itself."""
    first = fire(b, location=(-1.8, -1, -0.7))
    other = b.link(first.data, "Other", (0, -1, -0.7))
    other.material_slots[0].link = "OBJECT"
    other.material_slots[0].material = scattering("Dark", "density", 30, 0.2)


def attribute_times_texture(b):
    """Both the Density Attribute and a linked Density."""
    s = Shader("S")
    noise = s.node("TexNoise", Vector=s.node("TexCoord").outputs["Object"], Scale=3.0)
    fire(b, material=s.volume(grids(s, s.node("Math", "MULTIPLY", _0=noise.outputs["Fac"], _1=25.0))))


def black_body_without_its_grid(b):
    """Temperature is a number where the file has no grid of that name."""
    s = Shader("S")
    node = grids(s, 4.0, Blackbody_Intensity=0.5, Temperature=1500.0)
    node.inputs["Temperature Attribute"].default_value = "heat"
    fire(b, material=s.volume(node))


def clipped(b):
    """Blender leaves out voxels below the volume's Clipping."""
    fire(b).data.render.clipping = 0.35


# Mixtures.


def scatter_or_absorb(b):
    s = Shader("S")
    density = s.node("Math", "MULTIPLY", _0=s.attribute("density"), _1=20.0)
    fac = s.node("TexGradient", Vector=s.node("TexCoord").outputs["Object"]).outputs["Fac"]
    mix = s.node("MixShader", _0=fac, _1=s.node("VolumeScatter", Density=density), _2=s.node("VolumeAbsorption", Color=(0.8, 0.4, 0.2), Density=density))
    fire(b, material=s.volume(mix))


def smoke_and_fire_added(b):
    s = Shader("S")
    flame = s.node("Math", "MULTIPLY", _0=s.attribute("flame"), _1=6.0)
    fire(b, material=s.volume(s.node("AddShader", _0=grids(s, 12.0), _1=s.node("Emission", Color=(1, 0.4, 0.1), Strength=flame))))
    grey(b)


def drink(b):
    """Glass that is full of something."""
    s = Shader("Drink")
    s.volume(s.node("VolumeAbsorption", Color=(0.8, 0.3, 0.1), Density=1.5))
    b.mesh("uv_sphere", "Ball", s.surface(s.node("BsdfGlass", Color=(1, 1, 1), IOR=1.33)), segments=64, ring_count=32, smooth=True)
    grey(b)


def neon(b):
    s = Shader("Gas")
    tube = b.mesh("cylinder", "Tube", s.volume(s.node("Emission", Color=(1, 0.2, 0.4), Strength=2.0)), radius=0.15, depth=3, vertices=32)
    tube.rotation_euler = (0.3, 1.4, 0)
    grey(b)
    fire(b)


def two_fogs_by_noise(b):
    s = Shader("S")
    mask = s.node("TexNoise", Vector=s.node("TexCoord").outputs["Object"], Scale=2.0).outputs["Fac"]
    thin, thick = grids(s, 0.5), grids(s, 4.0, Color=(0.8, 0.3, 0.1))
    b.mesh("cube", "Box", s.volume(s.node("MixShader", _0=mask, _1=thin, _2=thick)), size=1.8)


def smoke_in_haze(b):
    fire(b)
    b.mesh("cube", "Haze", fog(0.15, "Haze"), size=5)
    sun(b)


# What modifiers, collections and frames do.


def rounded_for_renders(b):
    box = b.mesh("cube", "Box", fog(2), size=2)
    rounded = box.modifiers.new("Rounded", "SUBSURF")
    rounded.levels, rounded.render_levels = 0, 3


def hidden_things(b):
    """By keyframes, by a collection that renders hide, by another that is instanced nevertheless."""
    fire(b, "Shown", location=(-1.6, -1, -0.7))
    gone = fire(b, "Gone", location=(0, -1, -0.7))
    for frame, hidden in ((1, False), (5, True)):
        gone.hide_render = hidden
        gone.keyframe_insert("hide_render", frame=frame)
    box, ball = b.mesh("cube", "Box", diffuse("Box", (0.6, 0.2, 0.1)), size=0.8), b.mesh("uv_sphere", "Ball", fog(3), radius=0.5)
    for name, thing in (("Hidden", box), ("Kept away", ball)):
        collection = bpy.data.collections.new(name)
        b.scene.collection.children.link(collection)
        b.scene.collection.objects.unlink(thing)
        collection.objects.link(thing)
    bpy.data.collections["Hidden"].hide_render = True
    bpy.context.view_layer.layer_collection.children["Kept away"].exclude = True
    bpy.data.collections["Kept away"].instance_offset = (0.2, 0, 0.3)
    empty = b.link(None, "Instance", (1.2, -0.5, 0.3))
    empty.instance_type, empty.instance_collection = "COLLECTION", bpy.data.collections["Kept away"]
    grey(b)
    b.scene.frame_set(6)


def portrait(b):
    """An upright picture of a camera that fits it by itself, in part, over a transparent film."""
    render, data = b.scene.render, b.scene.camera.data
    render.resolution_x, render.resolution_y = 36, 48
    data.sensor_fit, data.shift_y = "AUTO", 0.1
    render.use_border, render.use_crop_to_border, render.film_transparent = True, True, True
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.1, 0.9, 0.2, 0.9
    fire(b)
    grey(b)


def orthographic(b):
    data = b.scene.camera.data
    data.type, data.ortho_scale, data.shift_x = "ORTHO", 4, 0.1
    fire(b)
    grey(b)


def no_world(b):
    b.scene.world = None
    fire(b)
    grey(b)
    b.light("POINT", "Point", (1, -2, 2), energy=200, shadow_soft_size=0)


def missing_picture(b):
    """Of a file that is not there."""
    s = Shader("Lost")
    image = s.node("TexImage")
    image.image = bpy.data.images.load(os.path.join(b.data, "volumes", "fire.vdb"))
    image.image.filepath = os.path.join(b.folder, "lost.png")
    b.mesh("cube", "Box", s.surface(s.node("BsdfDiffuse", Color=image.outputs["Color"])), size=1)
    s = Shader("Empty")
    ball = b.mesh("uv_sphere", "Ball", s.surface(s.node("BsdfDiffuse", Color=s.node("TexImage").outputs["Color"])), radius=0.4, location=(-1.3, 0, 0))
    ball.rotation_euler.x = 0.2
    grey(b)


def held_out(b):
    """A hole in an opaque film, beside and in smoke."""
    fire(b)
    grey(b)
    b.mesh("cube", "Hole", diffuse("Hole", (0.5, 0.5, 0.5)), size=0.9, location=(0, 0.2, 0.2)).is_holdout = True
    s = Shader("Nothing")
    b.mesh("cube", "Nothing", s.surface(s.node("Holdout")), size=0.5, location=(1.2, -1, 0.2))


HABITS = (
    fog_in_the_second_slot, material_set_by_nodes, density_of_a_property, materials_of_volumes, attribute_times_texture,
    black_body_without_its_grid, clipped, scatter_or_absorb, smoke_and_fire_added, drink, neon, two_fogs_by_noise, smoke_in_haze,
    rounded_for_renders, hidden_things, portrait, orthographic, no_world, missing_picture, held_out,
)  # fmt: skip


# What is said.


def inside_out(b):
    box = b.mesh("cube", "Box", fog(1), size=2)
    box.data.flip_normals()


def partly_a_hole(b):
    s = Shader("Part")
    b.mesh("cube", "Box", s.surface(s.node("MixShader", _0=0.3, _1=s.node("BsdfDiffuse"), _2=s.node("Holdout"))), size=1)


SAID = (
    (inside_out, "Box: its faces point inwards, where Cycles shows no fog; brume does"),
    (partly_a_hole, "Part: the material is a holdout by 0.3"),
    (missing_picture, "Lost: the image fire.vdb is not there: it is magenta"),
    (missing_picture, "Empty: an Image Texture has no image: it is magenta"),
)


class Habits(Comparison):
    def test_means_are_cycles(self):
        for kind in HABITS:
            with self.subTest(kind.__name__):
                self.compare(kind)

    def test_what_is_taken_instead_is_said(self):
        for kind, note in SAID:
            with self.subTest(kind.__name__):
                self.assertIn(note, "\n".join(self.translated(self.built(kind)).notes))


if __name__ == "__main__":
    scenes.run_tests(sys.modules[__name__])
