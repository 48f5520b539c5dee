# blender -b --factory-startup --python blender_scene.py -- EXPORTER VOLUME OUT.toml: makes a scene and exports it.
import math
import runpy
import sys

import bpy
from mathutils import Vector

exporter, volume, out = sys.argv[sys.argv.index("--") + 1 :]
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene


def add(name, data, location=(0, 0, 0)):
    thing = bpy.data.objects.new(name, data)
    thing.location = location
    scene.collection.objects.link(thing)
    return thing


camera = add("Camera", bpy.data.cameras.new("Camera"), (0, -7, 1.5))
camera.data.angle = math.radians(26.5)
camera.rotation_euler = (Vector((0, 0, 1.45)) - camera.location).to_track_quat("-Z", "Y").to_euler()
scene.camera = camera
scene.render.resolution_x = scene.render.resolution_y = 128
scene.render.resolution_percentage = 50

sun = add("Sun", bpy.data.lights.new("Sun", "SUN"))
sun.data.energy = 6
sun.rotation_euler = (0.9, 0.1, 0.4)
point = add("Point", bpy.data.lights.new("Point", "POINT"), (1, 1, 3))
point.data.shadow_soft_size = 0
add("Area", bpy.data.lights.new("Area", "AREA"), (0, 0, 4))

smoke = bpy.data.volumes.new("Smoke")
smoke.filepath = volume
add("Smoke", smoke, (-1, -1, 0))
material = bpy.data.materials.new("Smoke")
material.use_nodes = True
nodes = material.node_tree.nodes
nodes.clear()
shader = nodes.new("ShaderNodeVolumePrincipled")
shader.inputs["Density Attribute"].default_value = "density_noise"
shader.inputs["Density"].default_value = 18
shader.inputs["Absorption Color"].default_value = (0.5, 0.4, 0.3, 1)
output = nodes.new("ShaderNodeOutputMaterial")
material.node_tree.links.new(shader.outputs[0], output.inputs["Volume"])
smoke.materials.append(material)

mesh = bpy.data.meshes.new("Cube")
mesh.from_pydata([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [], [(0, 1, 2)])
add("Cube", mesh)


def volume_material(name, plug):
    """A Principled Volume, whose density `plug` fills: a function of the nodes' maker, linker and input."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    tree = made.node_tree
    tree.nodes.clear()
    principled = tree.nodes.new("ShaderNodeVolumePrincipled")
    tree.links.new(principled.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs["Volume"])
    plug(tree.nodes.new, tree.links.new, principled.inputs["Density"])
    return made


def times(number):
    """The attribute density_noise, halved, times a Value node."""

    def plug(new, link, density):
        attribute, halved, scaled, factor = (
            new("ShaderNode" + kind) for kind in ("Attribute", "Math", "Math", "Value")
        )
        attribute.attribute_name = "density_noise"
        halved.operation, scaled.operation = "DIVIDE", "MULTIPLY"
        halved.inputs[1].default_value = 2
        factor.outputs[0].default_value = number
        link(attribute.outputs["Fac"], halved.inputs[0])
        link(factor.outputs[0], scaled.inputs[0])
        link(halved.outputs[0], scaled.inputs[1])
        link(scaled.outputs[0], density)

    return plug


def noise(new, link, density):
    link(new("ShaderNodeTexNoise").outputs["Fac"], density)


for name, plug in (("Scaled", times(15)), ("Procedural", noise)):
    data = bpy.data.volumes.new(name)
    data.filepath = volume
    data.materials.append(volume_material(name, plug))
    add(name, data)

fog = bpy.data.meshes.new("Fog")
fog.from_pydata([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], [], [(0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3)])
fog.materials.append(volume_material("Fog", noise))
for place in (3, 5):
    add("Fog", fog, (place, 0, 0)).name = "Fog"

point.data.use_nodes = True
point.data.node_tree.nodes["Emission"].inputs["Strength"].default_value = 2
camera.keyframe_insert("location", frame=1)
sun.data.keyframe_insert("energy", frame=1)
scene.render.use_border = True
scene.render.pixel_aspect_x = 2
bpy.context.view_layer.update()
sys.argv = sys.argv[: sys.argv.index("--") + 1] + [out]
runpy.run_path(exporter, run_name="__main__")
