"""Writes the camera, volumes, lights and world of a Blender scene as a brume scene.

    blender -b shot.blend --python extras/blender_export.py -- shot.toml [frame=12]

Then guides for a frame that Cycles rendered of it:

    brume guides --like shot_0012.exr --scene shot.toml -o shot_0012.guides.exr
    brume denoise shot_0012.exr --guides shot_0012.guides.exr -o shot_0012.clean.exr

What brume has no counterpart of is left out and said, a line each: other shader nodes, textured worlds and lights, meshes.
Units: Blender's watts become radiance of areas and spheres, intensity of points and spots; a sun's strength is irradiance.
"""

import math
import os
import socket
import sys

import bpy
from mathutils import Matrix, Vector

left_out = []


def note(text):
    left_out.append(text)
    print("blender_export: " + text)


def number(x):
    return f"{float(x):.9g}"


def numbers(values):
    return "[" + ", ".join(number(v) for v in values) + "]"


def rows(matrix):
    return "[" + ", ".join(numbers(row) for row in matrix) + "]"


def value(socket, what):
    """Of a shader's input, where nothing is plugged in."""
    if socket.is_linked:
        note(f"{what}: '{socket.name}' is computed by nodes; its value without them is taken")
    v = socket.default_value
    return list(v)[:3] if hasattr(v, "__len__") else v


def camera_table(scene):
    camera = scene.camera
    if camera is None:
        raise SystemExit("blender_export: the scene has no camera")
    data, matrix = camera.data, camera.matrix_world.normalized()
    position = matrix.translation
    forward = matrix.to_3x3() @ Vector((0, 0, -1))
    up = matrix.to_3x3() @ Vector((0, 1, 0))
    render = scene.render
    width = render.resolution_x * render.pixel_aspect_x
    height = render.resolution_y * render.pixel_aspect_y
    axis = data.sensor_fit
    if axis == "AUTO":
        axis = "HORIZONTAL" if width >= height else "VERTICAL"
    sensor = data.sensor_height if data.sensor_fit == "VERTICAL" else data.sensor_width
    focus = data.dof.focus_distance
    if data.dof.focus_object is not None:
        focus = (data.dof.focus_object.matrix_world.translation - position).dot(forward)
    table = [
        "[camera]",
        f"position = {numbers(position)}",
        f"look_at = {numbers(position + forward * (focus if data.dof.use_dof else 1.0))}",
        f"up = {numbers(up)}",
        f'fov_axis = "{"x" if axis == "HORIZONTAL" else "y"}"',
    ]
    if data.type == "PERSP":
        table.append(f"fov = {number(math.degrees(2 * math.atan(0.5 * sensor / data.lens)))}")
        if data.dof.use_dof:
            table.append(f"lens_radius = {number(0.5e-3 * data.lens / data.dof.aperture_fstop)}")
            table.append(f"focus_distance = {number(focus)}")
    elif data.type == "ORTHO":
        table += ['type = "orthographic"', f"width = {number(data.ortho_scale)}"]
    else:
        raise SystemExit(f"blender_export: {camera.name}: brume has no {data.type} camera; it has PERSP and ORTHO")
    if data.shift_x or data.shift_y:
        note(f"{camera.name}: its shift is left out; brume takes shifts from the header of an EXR alone")
    share = render.resolution_percentage / 100
    table += [
        "",
        "[film]",
        f"width = {int(render.resolution_x * share)}",
        f"height = {int(render.resolution_y * share)}",
        f"exposure = {number(2 ** scene.view_settings.exposure)}",
    ]
    return table


def background(world):
    """Radiance of a constant world."""
    if world is None:
        return [0, 0, 0]
    if not world.use_nodes:
        return list(world.color)
    for node in world.node_tree.nodes:
        if node.type == "BACKGROUND":
            strength = value(node.inputs["Strength"], world.name)
            return [c * strength for c in value(node.inputs["Color"], world.name)]
    return [0, 0, 0]


def attribute_of(socket):
    """The grid that an Attribute or Volume Info node plugs in, without anything in between."""
    if not socket.is_linked:
        return None
    link = socket.links[0]
    if link.from_node.type == "ATTRIBUTE":
        return link.from_node.attribute_name
    if link.from_node.type == "VOLUME_INFO":
        return {"Density": "density", "Flame": "flame", "Temperature": "temperature"}.get(link.from_socket.name)
    return None


def principled(node, name):
    inputs = node.inputs
    table = [
        'preset = "principled"',
        f'grid = "{inputs["Density Attribute"].default_value or "density"}"',
        f"density = {number(value(inputs['Density'], name))}",
        f"color = {numbers(value(inputs['Color'], name))}",
        f"absorption_color = {numbers(value(inputs['Absorption Color'], name))}",
        f"g = {number(value(inputs['Anisotropy'], name))}",
    ]
    if inputs["Color Attribute"].default_value:
        table.append(f'albedo_grid = "{inputs["Color Attribute"].default_value}"')
    strength = value(inputs["Emission Strength"], name)
    if strength:
        table.append(f"emission = {numbers(c * strength for c in value(inputs['Emission Color'], name))}")
    intensity = value(inputs["Blackbody Intensity"], name)
    if intensity:
        grid = inputs["Temperature Attribute"].default_value
        table += [
            f'temperature_grid = "{grid or "temperature"}"',
            f"temperature_scale = {number(value(inputs['Temperature'], name))}",
            f"blackbody_intensity = {number(intensity)}",
            'blackbody_law = "stefan_boltzmann"',
        ]
    return table


def density_of(node, name):
    """The grid that drives a shader's density, and the factor on it."""
    density = node.inputs["Density"]
    if attribute_of(density):
        return attribute_of(density), 1.0
    source = density.links[0].from_node if density.is_linked else None
    if source is not None and source.type == "MATH" and source.operation == "MULTIPLY":
        for a, b in ((0, 1), (1, 0)):
            if attribute_of(source.inputs[a]) and not source.inputs[b].is_linked:
                return attribute_of(source.inputs[a]), source.inputs[b].default_value
    raise SystemExit(
        f"blender_export: {name}: the density of {node.name} is not one grid times a number, which is what brume takes"
    )


def coefficients(node, name, found):
    """Adds up Volume Scatter (density * color scatters) and Volume Absorption (density * (1 - color) is absorbed)."""
    if node.type == "ADD_SHADER":
        for socket in node.inputs:
            if socket.is_linked:
                coefficients(socket.links[0].from_node, name, found)
        return
    if node.type not in ("VOLUME_SCATTER", "VOLUME_ABSORPTION"):
        raise SystemExit(
            f"blender_export: {name}: its shader has {node.bl_idname}; brume takes Principled Volume, or sums of Volume "
            "Scatter and Volume Absorption"
        )
    grid, factor = density_of(node, name)
    if found.setdefault("grid", grid) != grid:
        raise SystemExit(f"blender_export: {name}: grids '{found['grid']}' and '{grid}' drive one shader; expected one")
    colour = value(node.inputs["Color"], name)
    if node.type == "VOLUME_SCATTER":
        g = value(node.inputs["Anisotropy"], name)
        if found.setdefault("g", g) != g:
            raise SystemExit(f"blender_export: {name}: Volume Scatters of several anisotropies; expected one")
        found["sigma_s"] = [s + factor * c for s, c in zip(found["sigma_s"], colour)]
    else:
        found["sigma_a"] = [s + factor * (1 - c) for s, c in zip(found["sigma_a"], colour)]


def scatter_and_absorption(node, name):
    found = {"sigma_s": [0, 0, 0], "sigma_a": [0, 0, 0]}
    coefficients(node, name, found)
    return [
        f'grid = "{found["grid"]}"',
        f"sigma_s = {numbers(found['sigma_s'])}",
        f"sigma_a = {numbers(found['sigma_a'])}",
        f"g = {number(found.get('g', 0))}",
    ]


def shader_of(volume):
    for slot in volume.material_slots:
        if slot.material is None or not slot.material.use_nodes:
            continue
        for node in slot.material.node_tree.nodes:
            if node.type == "OUTPUT_MATERIAL" and node.inputs["Volume"].is_linked:
                return node.inputs["Volume"].links[0].from_node
    return None


def volume_table(instance, folder):
    volume = instance.object
    grids = volume.data.grids
    grids.load()
    file = grids.frame_filepath or bpy.path.abspath(volume.data.filepath)
    table = ["[[volumes]]", f"file = '{os.path.relpath(bpy.path.abspath(file), folder)}'"]
    node = shader_of(volume)
    if node is None:
        table.append('preset = "principled"')
        note(f"{volume.name}: no volume shader; Blender's Principled Volume at its defaults is taken")
    elif node.type == "PRINCIPLED_VOLUME":
        table += principled(node, volume.name)
    else:
        table += scatter_and_absorption(node, volume.name)
    table.append(f"object_to_world = {rows(instance.matrix_world)}")
    if bpy.app.version < (5, 0, 0):
        # Measured on Cycles 3.4: the value of voxel (i, j, k) sits at its far corner's middle.
        table.append("index_offset = [0.5, 0.5, 0.5]")
    return table


def light_table(instance):
    light, matrix = instance.object.data, instance.matrix_world
    axes = matrix.to_3x3().normalized()
    towards = axes @ Vector((0, 0, 1))
    colour = Vector(light.color)
    if light.use_nodes and any(n.type not in ("EMISSION", "OUTPUT_LIGHT") for n in light.node_tree.nodes):
        note(f"{instance.object.name}: its nodes are left out")
    table = ["[[lights]]"]
    if light.type == "SUN":
        return table + [
            'type = "sun"',
            f"direction = {numbers(towards)}",
            f"irradiance = {numbers(colour * light.energy)}",
            f"angular_diameter = {number(math.degrees(light.angle))}",
        ]
    place = f"position = {numbers(matrix.translation)}"
    radius = light.shadow_soft_size
    if light.type == "POINT" and radius > 0:
        return table + [
            'type = "sphere"',
            place,
            f"radius = {number(radius)}",
            f"radiance = {numbers(colour * (light.energy / (4 * math.pi**2 * radius**2)))}",
        ]
    intensity = f"intensity = {numbers(colour * (light.energy / (4 * math.pi)))}"
    if light.type == "POINT":
        return table + ['type = "point"', place, intensity]
    if light.type == "SPOT":
        if radius > 0:
            note(f"{instance.object.name}: its size is left out; brume's spots are points")
        return table + [
            'type = "spot"',
            place,
            f"direction = {numbers(-towards)}",
            intensity,
            f"cone_angle = {number(math.degrees(light.spot_size))}",
            f"cone_softness = {number(light.spot_blend)}",
        ]
    size_x, size_y = light.size, light.size_y if light.shape in ("RECTANGLE", "ELLIPSE") else light.size
    area = size_x * size_y
    if light.shape in ("DISK", "ELLIPSE"):
        note(f"{instance.object.name}: its ellipse is a rectangle of the same area and power")
        size_x, size_y = size_x * math.sqrt(math.pi) / 2, size_y * math.sqrt(math.pi) / 2
        area = size_x * size_y
    scale = matrix.to_scale()
    edge_x = axes @ Vector((size_x * scale.x, 0, 0))
    edge_y = axes @ Vector((0, -size_y * scale.y, 0))
    corner = "" if edge_x.cross(edge_y).dot(-towards) > 0 else "the light shines backwards"
    if corner:
        note(f"{instance.object.name}: {corner}")
    area *= scale.x * scale.y
    return table + [
        'type = "rectangle"',
        place,
        f"edge_x = {numbers(edge_x)}",
        f"edge_y = {numbers(edge_y)}",
        f"radiance = {numbers(colour * (light.energy / (4 * area)))}",
    ]


def export(path):
    scene = bpy.context.scene
    folder = os.path.dirname(os.path.abspath(path))
    tables = [camera_table(scene)]
    tables.append(["[environment]", f"radiance = {numbers(background(scene.world))}"])
    for instance in bpy.context.evaluated_depsgraph_get().object_instances:
        kind = instance.object.type
        if not instance.show_self or instance.object.hide_render:
            continue
        if kind == "VOLUME":
            tables.append(volume_table(instance, folder))
        elif kind == "LIGHT":
            tables.append(light_table(instance))
        elif kind == "MESH":
            note(f"{instance.object.name}: the mesh is left out; give it as a file in [[surfaces]]")
    head = [f"# {bpy.path.basename(bpy.data.filepath) or 'A scene'} of Blender {bpy.app.version_string}, frame {scene.frame_current}."]
    head += ["# Left out: " + text for text in left_out]
    part = f"{path}.{socket.gethostname()}.{os.getpid()}.part"
    with open(part, "w", encoding="utf-8") as out:
        out.write("\n".join(head) + f'\nname = "{scene.name}"\n\n')
        out.write("\n\n".join("\n".join(table) for table in tables) + "\n")
    os.replace(part, path)


def main():
    arguments = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []
    if not arguments:
        raise SystemExit("blender_export: expected: blender -b FILE.blend --python blender_export.py -- OUT.toml [frame=N]")
    for option in arguments[1:]:
        key, _, text = option.partition("=")
        if key != "frame" or not text.lstrip("-").isdigit():
            raise SystemExit(f"blender_export: '{option}': expected frame=N")
        bpy.context.scene.frame_set(int(text))
    export(arguments[0])


main()
