"""Adds up the passes of a frame in Blender's compositor and compares the sum with Combined, bit by bit.

    blender -b --factory-startup --python apps/blender/blender_sum.py -- FRAME.exr VIEW_LAYER PASS PASS ...

Passes are added in the order given, as the attribute `brume.sum` states it. Prints how many values differ; exit status 1
when any does, 2 when Blender has no such layer or pass.
"""
import os
import struct
import sys
import tempfile

import bpy


def composite(path, layer, passes, folder):
    """Writes Combined and the sum of the passes side by side; returns the file's name."""
    scene = bpy.context.scene
    scene.use_nodes = True
    tree = scene.node_tree
    tree.nodes.clear()
    source = tree.nodes.new("CompositorNodeImage")
    source.image = bpy.data.images.load(path)
    source.layer = layer
    outputs = {o.name: o for o in source.outputs if o.enabled}
    for name in ["Combined"] + passes:
        if name not in outputs:
            print(f"no pass '{name}' in '{layer}'; there are: {', '.join(outputs)}")
            sys.exit(2)
    total = outputs[passes[0]]
    for name in passes[1:]:
        add = tree.nodes.new("CompositorNodeMixRGB")
        add.blend_type = "ADD"
        add.inputs["Fac"].default_value = 1
        tree.links.new(total, add.inputs[1])
        tree.links.new(outputs[name], add.inputs[2])
        total = add.outputs[0]
    target = tree.nodes.new("CompositorNodeOutputFile")
    target.base_path = os.path.join(folder, "sum")
    target.format.file_format = "OPEN_EXR_MULTILAYER"
    target.format.color_depth = "32"
    target.format.exr_codec = "NONE"
    target.file_slots.clear()
    for name, socket in (("whole", outputs["Combined"]), ("total", total)):
        target.file_slots.new(name)
        tree.links.new(socket, target.inputs[name])
    # What decides the size of the composite; only nodes are evaluated.
    scene.render.resolution_percentage = 100
    bpy.ops.render.render()
    return [os.path.join(folder, f) for f in os.listdir(folder) if f.startswith("sum")][0]


def channels(path):
    """The float channels of an uncompressed scan line EXR of one part, as bytes."""
    with open(path, "rb") as file:
        data = file.read()
    names, window, at = [], None, 8
    while data[at]:
        name, kind = data[at:data.index(0, at)], None
        at += len(name) + 1
        kind = data[at:data.index(0, at)]
        at += len(kind) + 1
        (size,) = struct.unpack_from("<i", data, at)
        value = data[at + 4:at + 4 + size]
        at += 4 + size
        if name == b"channels":
            k = 0
            while value[k]:
                end = value.index(0, k)
                names.append(value[k:end].decode())
                k = end + 17
        if name == b"dataWindow":
            window = struct.unpack("<4i", value)
    width, height = window[2] - window[0] + 1, window[3] - window[1] + 1
    lines = struct.unpack_from(f"<{height}Q", data, at + 1)
    planes = {name: b"" for name in names}
    for line in lines:
        for index, name in enumerate(names):
            start = line + 8 + index * width * 4
            planes[name] += data[start:start + width * 4]
    return planes


def rounded(values):
    """What 16 bits keep of floats, as floats."""
    return [struct.unpack("<e", struct.pack("<e", v))[0] for v in values]


def floats(plane):
    return list(struct.unpack(f"<{len(plane) // 4}f", plane))


def main():
    arguments = sys.argv[sys.argv.index("--") + 1:]
    path, layer, passes = arguments[0], arguments[1], arguments[2:]
    with tempfile.TemporaryDirectory() as folder:
        planes = channels(composite(os.path.abspath(path), layer, passes, folder))
    differing = values = 0
    for colour in "RGB":
        whole, total = floats(planes[f"whole.{colour}"]), floats(planes[f"total.{colour}"])
        if rounded(whole) == whole:  # stored as half: the sum is rounded once, too
            total = rounded(total)
        values += len(whole)
        differing += sum(a != b for a, b in zip(whole, total))
    print(f"{' + '.join(passes)} against Combined: {differing} of {values} values differ")
    sys.exit(1 if differing else 0)


main()
