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

bpy.context.view_layer.update()
sys.argv = sys.argv[: sys.argv.index("--") + 1] + [out]
runpy.run_path(exporter, run_name="__main__")
