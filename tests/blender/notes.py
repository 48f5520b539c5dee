"""Scenes full of what brume lacks: what is said, and that the rest is a scene that brume reads.

    blender -b --factory-startup --python tests/blender/notes.py -- FOLDER

FOLDER gets scene.toml and notes.txt, a line for each note, and errors.txt, a line for each scene that there is none of.
"""

import math
import os
import sys

import bpy

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.dirname(os.path.dirname(HERE))
sys.path[:0] = [HERE, os.path.join(ROOT, "apps", "blender")]
from brume_blender.translate import CannotTranslate, translate  # noqa: E402
from builder import Builder, Shader, diffuse, image, scattering  # noqa: E402


def cameras(b):
    camera = b.camera((0, -12, 4), (0, 0, 1))
    camera.data.clip_end = 100
    camera.data.dof.use_dof, camera.data.dof.aperture_ratio = True, 2.0
    camera.keyframe_insert("location", frame=0)
    camera.data.keyframe_insert("lens", frame=0)
    camera.location.x, camera.data.lens = 1, 40
    camera.keyframe_insert("location", frame=2)
    camera.data.keyframe_insert("lens", frame=2)


def lamps(b):
    b.light("AREA", "Disk", (0, 0, 5), energy=10, shape="DISK", size=1)
    b.light("AREA", "Narrow", (1, 0, 5), energy=10, size=1, spread=math.radians(60))
    b.light("SPOT", "Soft spot", (2, 0, 5), energy=10, shadow_soft_size=0.3)
    b.light("AREA", "Portal", (3, 0, 5), energy=10).data.cycles.is_portal = True
    b.light("SUN", "Shadowless", energy=1).data.cycles.cast_shadow = False
    b.light("POINT", "Picky", (0, 1, 5), energy=10).visible_glossy = False
    moving = b.light("POINT", "Moving lamp", (0, 2, 5), energy=10)
    moving.keyframe_insert("location", frame=0)
    moving.location.x = 1
    moving.keyframe_insert("location", frame=2)
    for name, node, output in (("Constant", "LightFalloff", "Constant"), ("Patterned", "TexNoise", "Fac")):
        lamp = b.light("POINT", name, (4, 0, 5), energy=10).data
        lamp.use_nodes = True
        tree = lamp.node_tree
        tree.links.new(tree.nodes.new("ShaderNode" + node).outputs[output], tree.nodes["Emission"].inputs["Strength"])


def worlds(b):
    tree = b.scene.world.node_tree
    sky = tree.nodes.new("ShaderNodeTexSky")
    sky.sky_type, sky.sun_elevation = "NISHITA", math.radians(-3)
    tree.links.new(sky.outputs[0], tree.nodes["Background"].inputs["Color"])
    fog = tree.nodes.new("ShaderNodeVolumeScatter")
    tree.links.new(fog.outputs[0], tree.nodes["World Output"].inputs["Volume"])
    b.scene.world.cycles_visibility.glossy = False


def volumes(b):
    b.volume("fire.vdb", "Bare", None)
    b.volume("missing_001.vdb", "Missing", scattering("Missing", "density", 1, 0.5)).data.is_sequence = True
    bpy.data.volumes["Missing"].frame_duration = 1
    s = Shader("Noisy")
    noise = s.node("TexNoise").outputs["Fac"]
    b.volume("fire.vdb", "Noisy", s.volume(s.node("VolumePrincipled", Density=noise)))
    s = Shader("Two grids")
    product = s.node("Math", "MULTIPLY", _0=s.attribute("density"), _1=s.attribute("flame"))
    b.volume("fire.vdb", "Two grids", s.volume(s.node("VolumeAbsorption", Density=product)))
    s = Shader("Glow")
    b.volume("fire.vdb", "Glow", s.volume(s.node("Emission", Strength=0.1))).visible_camera = False
    s = Shader("Plus")
    b.volume("fire.vdb", "Plus", s.volume(s.node("VolumeAbsorption", Density=s.node("Math", "ADD", _0=s.attribute("density"), _1=0.1))))
    s = Shader("Turning")
    b.volume("fire.vdb", "Turning", s.volume(s.node("VolumePrincipled", Anisotropy=s.attribute("density"))))
    s = Shader("Constant")
    b.volume("fire.vdb", "Constant density", s.volume(s.node("VolumeScatter", Density=1.0)))
    s = Shader("Round")
    b.mesh("cylinder", "Round fog", s.volume(s.node("VolumeScatter", Density=0.1)), location=(0, 6, 1))
    s = Shader("Gridless")
    b.mesh("cube", "Gridless fog", s.volume(s.node("VolumeScatter", Density=s.attribute("density"))), location=(3, 6, 1))


def materials(b, folder):
    s = Shader("Plastic")
    plastic = s.surface(s.node("BsdfPrincipled", Sheen=0.5))
    for i in range(2):
        b.mesh("cube", f"Plastic {i}", plastic, location=(i, 8, 0))
    s = Shader("Blend")
    b.mesh("cube", "Blend", s.surface(s.node("MixShader", _0=0.3, _1=s.node("BsdfDiffuse"), _2=s.node("BsdfGlossy"))), location=(3, 8, 0))
    s = Shader("Toon")
    b.mesh("cube", "Toon", s.surface(s.node("BsdfToon", Color=(0.5, 0.2, 0.2))), location=(4, 8, 0))
    s = Shader("Bumpy")
    bumpy = s.surface(s.node("BsdfDiffuse", Roughness=0.5, Normal=s.node("Bump").outputs[0]))
    s.put(s.output.inputs["Displacement"], s.node("Displacement").outputs[0])
    b.mesh("cube", "Bumpy", bumpy, location=(5, 8, 0))
    s = Shader("Clear")
    b.mesh("cube", "Clear", s.surface(s.node("BsdfTransparent")), location=(6, 8, 0))
    s = Shader("Checked")
    b.mesh("cube", "Checked", s.surface(s.node("BsdfDiffuse", Color=s.node("TexChecker").outputs["Color"])), location=(7, 8, 0))
    s = Shader("Boxed")
    texture = s.node("TexImage")
    texture.image, texture.projection, texture.extension = image("boxed", [[[0.2, 0.4, 0.6]] * 2] * 2, folder), "BOX", "CLIP"
    boxed = b.mesh("cube", "Boxed", s.surface(s.node("BsdfDiffuse", Color=texture)), location=(8, 8, 0))
    s = Shader("Bare image")
    texture = s.node("TexImage")
    texture.image = bpy.data.images["boxed.png"]
    bare = b.mesh("cube", "Bare", s.surface(s.node("BsdfDiffuse", Color=texture)), location=(9, 8, 0))
    bare.data.uv_layers.remove(bare.data.uv_layers[0])
    boxed.visible_shadow = False
    b.mesh("cube", "Far", diffuse("Far", (0.5, 0.5, 0.5)), location=(0, 120, 0))


def motion(b):
    render = b.scene.render
    render.use_motion_blur = True
    b.scene.cycles.rolling_shutter_type = "TOP"
    render.motion_blur_shutter_curve.curves[0].points[0].location[1] = 0.2
    soft = b.mesh("cube", "Soft", diffuse("Soft", (0.5, 0.5, 0.5)), location=(0, 10, 0))
    soft.shape_key_add(name="Basis")
    key = soft.shape_key_add(name="Wide")
    key.data[0].co.x -= 1
    for frame in (0, 2):
        key.value = frame / 2
        key.keyframe_insert("value", frame=frame)
    s = Shader("Torch")
    torch = b.mesh("cube", "Torch", s.surface(s.node("Emission")), location=(2, 10, 0))
    for frame in (0, 2):
        torch.location.x = 2 + frame / 4
        torch.keyframe_insert("location", frame=frame)


def errors(b):
    """What there is no scene of at all."""
    lines = []
    camera = b.scene.camera
    for change in ("PANO", "lamp", None):
        if change == "PANO":
            camera.data.type = change
        else:
            b.scene.camera = bpy.data.objects["Disk"] if change else None
        bpy.context.view_layer.update()
        try:
            translate(bpy.context.evaluated_depsgraph_get(), b.scene, ".")
            lines.append("no error")
        except CannotTranslate as error:
            lines.append(str(error))
    return lines


def main():
    folder = sys.argv[sys.argv.index("--") + 1]
    os.makedirs(folder, exist_ok=True)
    b = Builder(os.path.join(ROOT, "data"), 24, 18)
    cameras(b)
    lamps(b)
    worlds(b)
    volumes(b)
    materials(b, folder)
    motion(b)
    b.scene.frame_set(1)
    scene = b.scene
    result = translate(
        bpy.context.evaluated_depsgraph_get(), scene, folder, set_frame=lambda f, s: scene.frame_set(f, subframe=s)
    )
    for name, text in (("scene.toml", result.text), ("notes.txt", "\n".join(result.notes)), ("errors.txt", "\n".join(errors(b)))):
        with open(os.path.join(folder, name), "w", encoding="utf-8") as out:
            out.write(text)


main()
