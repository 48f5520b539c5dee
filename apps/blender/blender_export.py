"""Writes the camera, volumes, lights and world of a Blender scene as a brume scene.

    blender -b shot.blend --python apps/blender/blender_export.py -- shot.toml [frame=12]

Then guides for a frame that Cycles rendered of it:

    brume guides --like shot_0012.exr --scene shot.toml -o shot_0012.guides.exr
    brume denoise shot_0012.exr --guides shot_0012.guides.exr -o shot_0012.clean.exr

What brume has no counterpart of, and what moves, is said, a line for each object: other shader nodes, textured worlds and
lights, meshes, render borders, animation (the scene stands still as in its frame).
Units: Blender's watts become radiance of areas and spheres, intensity of points and spots; a sun's strength is irradiance.
"""

import math
import os
import socket
import sys

import bpy
from mathutils import Matrix, Vector

left_out = []


class LeftOut(Exception):
    """Why an object is not exported."""


def note(text):
    """Says what is left out or replaced, once however many instances it has."""
    if text in left_out:
        return
    left_out.append(text)
    print("blender_export: " + text)


def number(x):
    return f"{float(x):.9g}"


def numbers(values):
    return "[" + ", ".join(number(v) for v in values) + "]"


def rows(matrix):
    return "[" + ", ".join(numbers(row) for row in matrix) + "]"


def source_of(socket):
    """The output that is plugged into an input, past reroutes; None: nothing is."""
    while socket.is_linked:
        link = socket.links[0]
        if link.from_node.type != "REROUTE":
            return link.from_socket
        socket = link.from_node.inputs[0]
    return None


def constant(socket):
    """What an input is where at most a Value or RGB node is plugged in; None: it is computed."""
    source = source_of(socket)
    if source is not None and (source.node.type not in ("VALUE", "RGB") or source.type != socket.type):
        return None
    v = (source or socket).default_value
    return list(v)[:3] if hasattr(v, "__len__") else v


def value(socket, what):
    """Of a shader's input."""
    v = constant(socket)
    if v is None:
        note(f"{what}: '{socket.name}' is computed by nodes; its value without them is taken")
        v = socket.default_value
    return list(v)[:3] if hasattr(v, "__len__") else v


def moves(block, asked=()):
    """Whether key frames, drivers or tracks change an object, or what it is made of, follows or is a child of."""
    if block is None or block in asked:
        return False
    data = getattr(block, "animation_data", None)
    if data is not None and (data.action or data.drivers or data.nla_tracks):
        return True
    if isinstance(block, bpy.types.Object):
        others = [block.parent, block.data] + [getattr(c, "target", None) for c in block.constraints]
        others += [slot.material for slot in block.material_slots]
    else:
        others = [getattr(block, "node_tree", None)]
    return any(moves(other, (*asked, block)) for other in others)


def note_motion(thing, scene):
    if moves(thing):
        note(f"{thing.name}: its animation is left out; it is as in frame {scene.frame_current}, without motion blur")


def film_notes(render):
    if render.use_border:
        note(
            "Render border: left out, the whole picture is exported"
            + ("; frames cropped to the border are not seen by this camera" if render.use_crop_to_border else "")
        )
    if render.pixel_aspect_x != render.pixel_aspect_y:
        note(
            f"Pixel aspect {number(render.pixel_aspect_x)} : {number(render.pixel_aspect_y)}: left out, brume's pixels are "
            "square; frames of it are not seen by this camera"
        )


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
    note_motion(camera, scene)
    if data.dof.use_dof and (data.type == "ORTHO" or data.dof.aperture_blades or data.dof.aperture_ratio != 1):
        note(f"{camera.name}: " + ("its depth of field is left out" if data.type == "ORTHO" else "its aperture is a disc here"))
    film_notes(render)
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
    if any(n.type == "OUTPUT_WORLD" and n.inputs["Volume"].is_linked for n in world.node_tree.nodes):
        note(f"{world.name}: its volume is left out")
    for node in world.node_tree.nodes:
        if node.type == "BACKGROUND":
            strength = value(node.inputs["Strength"], world.name)
            return [c * strength for c in value(node.inputs["Color"], world.name)]
    return [0, 0, 0]


def grid_times_number(socket):
    """(grid, factor) where Attribute or Volume Info plugs in, multiplied or divided by numbers or not; None: anything else."""
    source = source_of(socket)
    if source is None:
        return None
    node = source.node
    if node.type == "ATTRIBUTE" and node.attribute_type == "GEOMETRY":
        return node.attribute_name, 1.0
    if node.type == "VOLUME_INFO":
        grid = {"Density": "density", "Flame": "flame", "Temperature": "temperature"}.get(source.name)
        return (grid, 1.0) if grid else None
    if node.type != "MATH" or node.use_clamp or node.operation not in ("MULTIPLY", "DIVIDE"):
        return None
    for a, b in ((0, 1), (1, 0)) if node.operation == "MULTIPLY" else ((0, 1),):
        found, factor = grid_times_number(node.inputs[a]), constant(node.inputs[b])
        if found and factor is not None and (factor or node.operation == "MULTIPLY"):
            return found[0], found[1] * factor if node.operation == "MULTIPLY" else found[1] / factor
    return None


def check_grid(grid, grids):
    if grid not in grids:
        raise LeftOut(f"its file has no grid '{grid}'; it has: {', '.join(grids)}")


def principled_density(inputs, name, grids):
    """The grid and the factor on it. Cycles multiplies what is plugged in by the grid of Density Attribute, if there is one."""
    attribute = inputs["Density Attribute"].default_value
    plugged = grid_times_number(inputs["Density"])
    if plugged:
        if plugged[0] in grids and attribute in grids:
            note(f"{name}: the grids '{plugged[0]}' and '{attribute}' multiply to its density; '{plugged[0]}' alone is taken")
        return plugged
    if attribute in grids:
        return attribute, value(inputs["Density"], name)
    raise LeftOut("no grid of its file drives its density; brume takes one grid times a number")


def principled(node, name, grids):
    inputs = node.inputs
    grid, density = principled_density(inputs, name, grids)
    check_grid(grid, grids)
    table = [
        'preset = "principled"',
        f'grid = "{grid}"',
        f"density = {number(density)}",
        f"color = {numbers(value(inputs['Color'], name))}",
        f"absorption_color = {numbers(value(inputs['Absorption Color'], name))}",
        f"g = {number(value(inputs['Anisotropy'], name))}",
    ]
    if inputs["Color Attribute"].default_value in grids:
        table.append(f'albedo_grid = "{inputs["Color Attribute"].default_value}"')
    strength = value(inputs["Emission Strength"], name)
    if strength:
        table.append(f"emission = {numbers(c * strength for c in value(inputs['Emission Color'], name))}")
    intensity = value(inputs["Blackbody Intensity"], name)
    temperature = inputs["Temperature Attribute"].default_value
    if intensity and temperature not in grids:
        note(f"{name}: its black body is left out: no grid drives its temperature ('{temperature}' is not in its file)")
    elif intensity:
        table += [
            f'temperature_grid = "{temperature}"',
            f"temperature_scale = {number(value(inputs['Temperature'], name))}",
            f"blackbody_intensity = {number(intensity)}",
            'blackbody_law = "stefan_boltzmann"',
        ]
    return table


def density_of(node):
    """The grid that drives a shader's density, and the factor on it."""
    found = grid_times_number(node.inputs["Density"])
    if found is None:
        raise LeftOut(f"the density of {node.name} is not one grid times a number, which is what brume takes")
    return found


def coefficients(node, name, found):
    """Adds up Volume Scatter (density * color scatters) and Volume Absorption (density * (1 - color) is absorbed)."""
    if node.type == "ADD_SHADER":
        for socket in node.inputs:
            if socket.is_linked:
                coefficients(socket.links[0].from_node, name, found)
        return
    if node.type not in ("VOLUME_SCATTER", "VOLUME_ABSORPTION"):
        raise LeftOut(
            f"its shader has {node.bl_idname}; brume takes Principled Volume, or sums of Volume Scatter and Volume Absorption"
        )
    grid, factor = density_of(node)
    if found.setdefault("grid", grid) != grid:
        raise LeftOut(f"grids '{found['grid']}' and '{grid}' drive its shader; expected one")
    colour = value(node.inputs["Color"], name)
    if node.type == "VOLUME_SCATTER":
        g = value(node.inputs["Anisotropy"], name)
        if found.setdefault("g", g) != g:
            raise LeftOut("its shader has Volume Scatters of several anisotropies; expected one")
        found["sigma_s"] = [s + factor * c for s, c in zip(found["sigma_s"], colour)]
    else:
        found["sigma_a"] = [s + factor * (1 - c) for s, c in zip(found["sigma_a"], colour)]


def scatter_and_absorption(node, name, grids):
    found = {"sigma_s": [0, 0, 0], "sigma_a": [0, 0, 0]}
    coefficients(node, name, found)
    check_grid(found["grid"], grids)
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
    names = [grid.name for grid in grids]
    if node is None:
        table.append('preset = "principled"')
        note(f"{volume.name}: no volume shader; Blender's Principled Volume at its defaults is taken")
    elif node.type == "PRINCIPLED_VOLUME":
        table += principled(node, volume.name, names)
    else:
        table += scatter_and_absorption(node, volume.name, names)
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
    for node in light.node_tree.nodes if light.use_nodes else []:
        if node.type == "EMISSION":
            strength = value(node.inputs["Strength"], instance.object.name)
            colour = Vector(c * strength * e for c, e in zip(colour, value(node.inputs["Color"], instance.object.name)))
        elif node.type != "OUTPUT_LIGHT":
            note(f"{instance.object.name}: its nodes but Emission are left out")
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
    if light.spread < math.pi:
        note(f"{instance.object.name}: its spread is left out; brume's areas shine to all sides in front")
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


# What is never seen: cameras, helpers.
UNSEEN = ("CAMERA", "EMPTY", "ARMATURE", "LATTICE", "LIGHT_PROBE", "SPEAKER")


def note_other(thing):
    """What an object is that is neither a volume nor a light."""
    if any(m.type == "FLUID" and m.fluid_type == "DOMAIN" for m in thing.modifiers):
        note(f"{thing.name}: the fluid domain is left out; import its cache's OpenVDB files as a Volume object")
    elif shader_of(thing) is not None:
        note(
            f"{thing.name}: the volume inside the {thing.type.lower()} is left out; brume fills boxes and balls: [[volumes]] "
            'with shape = "box" or "sphere"'
        )
    else:
        note(f"{thing.name}: the {thing.type.lower()} is left out; give it as a file in [[surfaces]]")


def export(path):
    scene = bpy.context.scene
    folder = os.path.dirname(os.path.abspath(path))
    tables = [camera_table(scene)]
    tables.append(["[environment]", f"radiance = {numbers(background(scene.world))}"])
    if scene.world is not None:
        note_motion(scene.world, scene)
    for instance in bpy.context.evaluated_depsgraph_get().object_instances:
        kind = instance.object.type
        if not instance.show_self or instance.object.hide_render:
            continue
        try:
            if kind == "VOLUME":
                tables.append(volume_table(instance, folder))
            elif kind == "LIGHT":
                tables.append(light_table(instance))
            elif kind not in UNSEEN:
                note_other(instance.object)
        except LeftOut as reason:
            note(f"{instance.object.name}: the volume is left out: {reason}")
            continue
        if kind in ("VOLUME", "LIGHT"):
            for thing in filter(None, (instance.object, instance.parent)):
                note_motion(thing.original, scene)
    if not any(table[0] == "[[volumes]]" for table in tables):
        raise SystemExit("blender_export: no volume could be exported")
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
