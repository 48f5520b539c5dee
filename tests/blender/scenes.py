"""Scenes in which everything has a counterpart in brume, one for each line of what is translated; Cycles renders them, and
they are written as brume scenes:

    blender -b --factory-startup --python tests/blender/scenes.py -- SCENE FOLDER [samples=64]

FOLDER gets cycles_1.exr and cycles_2.exr, two independent renders, and scene.toml.
"""

import math
import os
import sys

import bpy
import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.dirname(os.path.dirname(HERE))
sys.path[:0] = [HERE, os.path.join(ROOT, "apps", "blender")]
from brume_blender.translate import translate  # noqa: E402
from brume_blender.translate.pictures import write_exr  # noqa: E402
from builder import Builder, Shader, diffuse, image, scattering  # noqa: E402


def perspective(b, folder):
    """Shift, a vertical fit of the sensor, pixels that are not square."""
    camera = b.camera((0.4, -8, 2.2), (0, 0, 1.3))
    camera.data.sensor_fit, camera.data.sensor_height, camera.data.lens = "VERTICAL", 20, 34
    camera.data.shift_x, camera.data.shift_y = 0.12, -0.08
    b.scene.render.pixel_aspect_x, b.scene.render.pixel_aspect_y = 1.4, 1.0
    b.world([0.2, 0.25, 0.3])
    b.light("SUN", "Sun", look_at=(0.5, 0.4, -0.8), energy=4, angle=math.radians(4))
    b.floor(diffuse("Floor", (0.5, 0.4, 0.3)))
    b.volume("smoke.vdb", "Smoke", scattering("Smoke", "density_noise", 14, 0.85, 0.3), (-1, -1, 0))


def orthographic(b, folder):
    """Parallel rays, shift, a lens with five blades."""
    camera = b.camera((3, -6, 4), (0, 0, 0.6))
    data = camera.data
    data.type, data.ortho_scale, data.sensor_fit = "ORTHO", 4.5, "AUTO"
    data.shift_x, data.shift_y = -0.1, 0.06
    data.dof.use_dof, data.dof.focus_distance, data.dof.aperture_fstop = True, 5.2, 1.2
    data.dof.aperture_blades, data.dof.aperture_rotation = 5, math.radians(20)
    b.world([0.3, 0.3, 0.3])
    b.floor(diffuse("Floor", (0.4, 0.5, 0.4)))
    lamp = Shader("Lamp")
    glowing = lamp.surface(lamp.node("Emission", Color=(1, 0.7, 0.3), Strength=6.0))
    for i, (x, y) in enumerate([(-1.2, -1.5), (0.3, 0.2), (1.6, 1.8), (-0.6, 2.6)]):
        b.mesh("ico_sphere", f"Lamp {i}", glowing, subdivisions=3, radius=0.12, location=(x, y, 0.5 + 0.3 * i))
    b.mesh("cube", "Block", diffuse("Block", (0.7, 0.3, 0.2)), size=0.8, location=(-0.2, 0.9, 0.4))


def motion(b, folder):
    """Camera, mesh and volume that move while the shutter is open, smoke that its velocity grid moves."""
    scene = b.scene
    scene.render.use_motion_blur, scene.render.motion_blur_shutter = True, 0.8
    camera = b.camera((0, -9, 2.4), (0, 0, 1.2), 34)
    camera.keyframe_insert("location", frame=0)
    camera.location = (0.5, -9, 2.5)
    camera.keyframe_insert("location", frame=2)
    b.world([0.25, 0.25, 0.3])
    b.light("SUN", "Sun", look_at=(0.4, 0.5, -0.9), energy=3, angle=math.radians(5))
    b.floor(diffuse("Floor", (0.5, 0.5, 0.5)))
    block = b.mesh("cube", "Block", diffuse("Block", (0.8, 0.3, 0.2)), size=0.7, location=(-2.2, 0, 0.5))
    puff = b.volume("smoke.vdb", "Puff", scattering("Puff", "density_noise", 9, 0.95), (1.3, 0.0, 0.5))
    puff.scale = (0.6, 0.6, 0.6)
    smoke = b.volume(os.path.join(folder, "moving.vdb"), "Smoke", scattering("Smoke", "density", 5, 0.9), (-0.3, 0, 0.85))
    smoke.data.grids.load()
    smoke.data.velocity_grid, smoke.data.velocity_scale, smoke.data.velocity_unit = "vel", 0.25, "FRAME"
    for thing, step in ((block, (0.5, 0.1, 0.2)), (puff, (0.2, 0, 0.4))):
        start = thing.location.copy()
        for frame, sign in ((0, -1), (2, 1)):
            thing.location = [s + sign * d for s, d in zip(start, step)]
            thing.keyframe_insert("location", frame=frame)
    for action in bpy.data.actions:
        for curve in action.fcurves:
            for key in curve.keyframe_points:
                key.interpolation = "LINEAR"
    scene.frame_set(1)


def fire(b, folder):
    """Principled Volume: density, colours, black body of a temperature grid; the fire lights a floor."""
    b.camera((0, -6, 1.6), (0, 0, 1.0), 34)
    b.world([0.02, 0.02, 0.03])
    b.floor(diffuse("Floor", (0.6, 0.5, 0.4)))
    s = Shader("Fire")
    node = s.node(
        "VolumePrincipled", Color=(0.6, 0.55, 0.5), Density=5.0, Absorption_Color=(0.2, 0.3, 0.1), Anisotropy=0.2,
        Blackbody_Intensity=0.05, Temperature=1500.0,
    )  # fmt: skip
    b.volume("fire.vdb", "Fire", s.volume(node), (-1, -1, 0))


def shaders(b, folder):
    """Scatter, absorption and emission, added and mixed, driven by attributes times and plus numbers and by curves."""
    b.camera((0, -6.5, 1.4), (0, 0, 1.1), 33)
    b.world([0.2, 0.22, 0.25])
    b.light("SUN", "Sun", look_at=(-0.6, 0.4, -0.7), energy=5, angle=math.radians(3))
    s = Shader("Mixture")
    density, flame = s.attribute("density"), s.attribute("flame")
    thin = s.node("Math", "MULTIPLY_ADD", _0=density, _1=14.0, _2=-0.1)
    curve = s.tree.nodes.new("ShaderNodeFloatCurve")
    points = curve.mapping.curves[0].points
    points[0].location, points[1].location = (0, 0), (1, 0.85)
    points.new(0.5, 0.47)
    s.put(curve.inputs["Value"], density)
    thick = s.node("Math", "MULTIPLY", _0=curve, _1=16.0)
    # One scatter: Cycles 3.4 takes sampled light twice where two phase functions meet.
    scatter = s.node("VolumeScatter", Color=(0.9, 0.8, 0.7), Density=thin, Anisotropy=0.4)
    grey = s.node("VolumeAbsorption", Color=(0.5, 0.5, 0.5), Density=thin)
    dark = s.node("VolumeAbsorption", Color=(0.8, 0.6, 0.4), Density=thick)
    ramp = s.node("ValToRGB", Fac=flame)
    ramp.color_ramp.elements[0].color, ramp.color_ramp.elements[1].color = (0, 0, 0, 1), (1, 0.5, 0.1, 1)
    ramp.color_ramp.elements.new(0.4).color = (0.6, 0.05, 0.01, 1)
    glow = s.node("Emission", Color=ramp.outputs["Color"], Strength=1.5)
    both = s.node("MixShader", _0=0.3, _1=scatter, _2=grey)
    b.volume("fire.vdb", "Mixture", s.volume(s.node("AddShader", _0=s.node("AddShader", _0=both, _1=dark), _1=glow)), (-1, -1, 0))


def fog(b, folder):
    """Fog in meshes' boxes and balls, instances of a collection, lamps within."""
    b.camera((0, -9, 2.5), (0, 0, 1.1), 32)
    b.world([0.1, 0.1, 0.12])
    b.floor(diffuse("Floor", (0.4, 0.4, 0.4)))
    s = Shader("Fog")
    box = b.mesh("cube", "Box", s.volume(s.node("VolumePrincipled", Color=(0.8, 0.85, 0.9), Density=0.35, Anisotropy=0.3)), size=2)
    box.location, box.scale, box.rotation_euler = (-0.3, 1.5, 1.01), (1.6, 0.8, 1.0), (0, 0, 0.3)
    s = Shader("Ball")
    scatter = s.node("VolumeScatter", Color=(0.9, 0.5, 0.4), Density=2.5)
    b.mesh("ico_sphere", "Ball", s.volume(scatter), subdivisions=6, radius=0.6, location=(-1.7, -1.4, 0.7))
    puff = b.volume("fire.vdb", "Puff", scattering("Puff", "density", 8, 0.9, 0.2), (-1, -1, 0))
    stone = b.mesh("cube", "Stone", diffuse("Stone", (0.3, 0.4, 0.7)), size=0.5, location=(0.9, -0.9, 0.25))
    instance = b.collection("Group", [puff, stone])
    instance((1.5, -1.2, 0), 0.7, 0.5)
    instance((2.6, 1.2, 0), 0.9, -0.8)
    b.light("POINT", "Lamp", (0.3, -0.4, 2.4), energy=150, shadow_soft_size=0.02)


def lights(b, folder):
    """A lamp of each kind, nodes for strength and colour."""
    b.camera((0, -10, 4.5), (0, 0, 0.8), 34)
    b.floor(diffuse("Floor", (0.7, 0.7, 0.7)))
    b.mesh("cube", "Block", diffuse("Block", (0.6, 0.6, 0.6)), size=1, location=(0, 0.4, 0.5))
    s = Shader("Haze")
    haze = b.mesh("cube", "Haze", s.volume(s.node("VolumeScatter", Color=(0.9, 0.9, 0.9), Density=0.12)), size=2)
    haze.location, haze.scale = (0, 0, 1.9), (3.5, 2.5, 0.9)
    b.light("SUN", "Sun", look_at=(0.8, 0.5, -0.6), energy=0.5, angle=math.radians(2), color=(0.6, 0.8, 1))
    b.light("POINT", "Point", (-2.6, -1, 1.2), energy=60, shadow_soft_size=0)
    b.light("POINT", "Ball", (-1, -2, 0.7), energy=30, shadow_soft_size=0.05, color=(1, 0.5, 0.4))
    b.light("SPOT", "Spot", (2, -1.5, 3.2), (1.2, 0, 0), energy=400, spot_size=math.radians(50), spot_blend=0.4, shadow_soft_size=0)
    area = b.light("AREA", "Area", (0, 2.5, 2.5), (0, 0, 0.5), energy=80, shape="RECTANGLE", size=1.2, size_y=0.5)
    area.scale = (1.0, 1.3, 1.0)
    b.light("AREA", "Square", (3, 1, 1.5), (1, 0.5, 0), energy=40, shape="SQUARE", size=0.5)
    for name, kelvin, strength in (("Point", 3000, 1.6), ("Area", 7500, 0.8)):
        light = bpy.data.lights[name]
        light.use_nodes = True
        nodes, emission = light.node_tree.nodes, light.node_tree.nodes["Emission"]
        body = nodes.new("ShaderNodeBlackbody")
        body.inputs[0].default_value = kelvin
        light.node_tree.links.new(body.outputs[0], emission.inputs["Color"])
        emission.inputs["Strength"].default_value = strength


def world(b, folder):
    """A lat-long picture, turned by a Mapping node, behind a transparent film; a volume whose density goes by its scale."""
    y, x = np.mgrid[0:64, 0:128] / 64.0
    picture = np.stack([0.2 + 0.2 * np.sin(3 * x), 0.3 + 0.2 * y, 0.5 - 0.2 * y], -1)
    picture += 12 * np.exp(-((x - 0.6) ** 2 + (y - 0.35) ** 2) / 0.004)[..., None] * [1, 0.9, 0.7]
    path = os.path.join(folder, "sky.exr")
    write_exr(path, picture.astype(np.float32))
    tree = b.scene.world.node_tree
    sky, mapping, coordinates = (tree.nodes.new("ShaderNode" + kind) for kind in ("TexEnvironment", "Mapping", "TexCoord"))
    sky.image = bpy.data.images.load(path)
    mapping.inputs["Rotation"].default_value = (0.2, -0.15, 1.1)
    tree.links.new(coordinates.outputs["Generated"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs[0], sky.inputs["Vector"])
    tree.links.new(sky.outputs["Color"], tree.nodes["Background"].inputs["Color"])
    tree.nodes["Background"].inputs["Strength"].default_value = 0.8
    b.scene.render.film_transparent = True
    b.camera((0, -7, 1.8), (0, 0, 1.1), 34)
    b.mesh("plane", "Plate", diffuse("Plate", (0.6, 0.6, 0.6)), size=3, location=(0.4, 0, 0))
    b.mesh("ico_sphere", "Ball", diffuse("Ball", (0.8, 0.7, 0.6)), smooth=True, subdivisions=4, radius=0.5, location=(1.1, -0.6, 0.5))
    smoke = b.volume("smoke.vdb", "Smoke", scattering("Smoke", "density_noise", 13, 0.9), (-1, -1, 0))
    smoke.scale, smoke.data.render.space = (0.9, 0.8, 0.7), "OBJECT"


def meshes(b, folder):
    """Modifiers, smooth and flat faces, text; diffuse, glossy, glass, metal, emission; an image on the base colour."""
    b.camera((0, -9, 3.2), (0, 0, 0.7), 32)
    b.world([0.35, 0.4, 0.45])
    # Without edges: Cycles interpolates between sRGB values, brume between linear ones.
    y, x = np.mgrid[0:64, 0:64] / 64 * 2 * math.pi
    waves = 0.5 + 0.3 * np.stack([np.sin(x) * np.sin(y), np.sin(x + 1), np.cos(2 * y)], -1)
    s = Shader("Tiles")
    texture = s.node("TexImage", Vector=s.node("Mapping", Vector=s.node("TexCoord").outputs["UV"], Scale=(3, 2, 1)))
    texture.image = image("tiles", waves, folder)
    b.mesh("plane", "Floor", s.surface(s.node("BsdfDiffuse", Color=texture)), size=9)
    s = Shader("Metal")
    b.mesh("uv_sphere", "Metal", s.surface(s.node("BsdfGlossy", Color=(0.9, 0.7, 0.5), Roughness=0.3)), True, radius=0.6, location=(-2, 0, 0.6))
    s = Shader("Mirror")
    b.mesh("uv_sphere", "Mirror", s.surface(s.node("BsdfGlossy", Color=(0.8, 0.85, 0.9), Roughness=0.0)), True, radius=0.5, location=(-0.8, -1.4, 0.5))
    s = Shader("Glass")
    b.mesh("uv_sphere", "Glass", s.surface(s.node("BsdfGlass", Color=(1, 1, 1), Roughness=0.0, IOR=1.45)), True, segments=64, ring_count=32, radius=0.6, location=(0.6, -1.2, 0.6))
    for node in bpy.data.materials["Metal"].node_tree.nodes:
        if node.type == "BSDF_GLOSSY":
            node.distribution = "GGX"
    s = Shader("Lamp")
    b.mesh("plane", "Lamp", s.surface(s.node("Emission", Color=(1, 0.9, 0.8), Strength=4.0)), size=1.2, location=(0, 1.5, 2.6))
    monkey = b.mesh("monkey", "Head", diffuse("Head", (0.7, 0.4, 0.3)), True, size=1.2, location=(1.9, 0.4, 0.7))
    monkey.modifiers.new("Finer", "SUBSURF").levels = 1
    monkey.modifiers["Finer"].render_levels = 1
    post = b.mesh("cube", "Post", diffuse("Post", (0.3, 0.6, 0.4)), size=0.3, location=(-2.5, 1.5, 0.15))
    array = post.modifiers.new("Row", "ARRAY")
    array.count, array.relative_offset_displace = 5, (1.6, 0, 0)
    bpy.ops.object.text_add(location=(-1, 0.6, 0.02))
    text = bpy.context.object
    text.data.body, text.data.extrude = "fog", 0.1
    text.data.materials.append(diffuse("Ink", (0.1, 0.1, 0.4)))


def roles(b, folder):
    """A holdout, a mesh that the camera does not see, a transparent film."""
    b.scene.render.film_transparent = True
    b.camera((0, -8, 2.6), (0, 0, 0.9), 32)
    b.world([0.3, 0.35, 0.4])
    b.light("SUN", "Sun", look_at=(0.5, 0.6, -0.9), energy=3, angle=math.radians(3))
    b.mesh("plane", "Floor", diffuse("Floor", (0.6, 0.5, 0.4)), size=6)
    hole = b.mesh("cube", "Hole", diffuse("Hole", (0.8, 0.8, 0.8)), size=0.9, location=(-1.3, -0.8, 0.45))
    hole.is_holdout = True
    unseen = b.mesh("cube", "Unseen", diffuse("Unseen", (0.9, 0.2, 0.1)), size=1, location=(1.4, -0.2, 0.5))
    unseen.visible_camera = False
    b.volume("fire.vdb", "Smoke", scattering("Smoke", "density", 9, 0.9), (-0.9, -0.6, 0.02))


def fluid(b, folder):
    """A smoke domain with a cache of OpenVDB files, made here."""
    b.camera((0, -9, 2.4), (0, 0, 2), 34)
    b.world([0.3, 0.3, 0.35])
    b.light("SUN", "Sun", look_at=(-0.5, 0.5, -0.8), energy=3, angle=math.radians(4))
    b.floor(diffuse("Floor", (0.5, 0.45, 0.4)))
    s = Shader("Smoke")
    domain = b.mesh("cube", "Domain", s.volume(s.node("VolumePrincipled", Color=(0.7, 0.7, 0.7), Density=4.0)), size=2)
    domain.location, domain.scale = (0, 0, 2), (1.2, 1.2, 2)
    domain.modifiers.new("Fluid", "FLUID").fluid_type = "DOMAIN"
    settings = domain.modifiers["Fluid"].domain_settings
    settings.domain_type, settings.resolution_max, settings.cache_data_format = "GAS", 32, "OPENVDB"
    settings.cache_directory, settings.cache_type = os.path.join(folder, "cache"), "REPLAY"
    settings.cache_frame_start, settings.cache_frame_end = 1, 8
    source = b.mesh("uv_sphere", "Source", radius=0.4, location=(0.1, 0, 0.8))
    source.hide_render = True
    source.modifiers.new("Fluid", "FLUID").fluid_type = "FLOW"
    flow = source.modifiers["Fluid"].flow_settings
    flow.flow_type, flow.flow_behavior, flow.use_initial_velocity, flow.velocity_coord = "SMOKE", "INFLOW", True, (0, 0, 4)
    for frame in range(1, 9):
        b.scene.frame_set(frame)


def _under_a_sky(b, model):
    b.scene.render.resolution_x, b.scene.render.resolution_y = 20, 15
    b.camera((0, -4, 5), (0, 0, 0), 30)
    b.floor(diffuse("Floor", (0.8, 0.8, 0.8)), 60)
    tree = b.scene.world.node_tree
    sky = tree.nodes.new("ShaderNodeTexSky")
    sky.sky_type, sky.turbidity, sky.sun_direction = model, 3, (0.5, 0.4, 0.6)
    sky.sun_elevation, sky.sun_rotation = math.radians(40), 1.0
    tree.links.new(sky.outputs[0], tree.nodes["Background"].inputs["Color"])


def sky_preetham(b, folder):
    _under_a_sky(b, "PREETHAM")


def sky_hosek(b, folder):
    _under_a_sky(b, "HOSEK_WILKIE")


def sky_nishita(b, folder):
    _under_a_sky(b, "NISHITA")


SCENES = {
    f.__name__: f
    for f in (
        perspective, orthographic, motion, fire, shaders, fog, lights, world, meshes, roles, fluid, sky_preetham, sky_hosek,
        sky_nishita,
    )
}  # fmt: skip


def main():
    name, folder, *options = sys.argv[sys.argv.index("--") + 1 :]
    samples = int(dict(option.split("=") for option in options).get("samples", 64))
    os.makedirs(folder, exist_ok=True)
    b = Builder(os.path.join(ROOT, "data"))
    SCENES[name](b, folder)
    b.plain(samples)
    scene = b.scene
    result = translate(
        bpy.context.evaluated_depsgraph_get(), scene, folder, set_frame=lambda f, s: scene.frame_set(f, subframe=s)
    )
    with open(os.path.join(folder, "scene.toml"), "w", encoding="utf-8") as out:
        out.write(result.text)
    for note in result.notes:
        print("NOTE " + note)
    for seed in (1, 2):
        b.render(os.path.join(folder, f"cycles_{seed}.exr"), seed)


main()
