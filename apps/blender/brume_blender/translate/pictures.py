"""Pictures as arrays: Blender's images, files that brume reads, look-ups."""

import os
import struct

import bpy
import numpy as np

from .colour import linear_from_srgb

LINEAR = ("Linear", "Linear Rec.709", "scene_linear", "Raw", "Non-Color", "Generic Data")
DATA = ("Raw", "Non-Color", "Generic Data")
SRGB = ("sRGB", "Filmic sRGB")


class NoPicture(Exception):
    """Why an image has no pixels."""


def is_linear(image):
    return image.colorspace_settings.name in LINEAR


def is_cut(node):
    """Whether the colours of an Image Texture are times the image's alpha: where its own Alpha is not used."""
    image = node.image
    own = image.channels == 4 and image.alpha_mode in ("STRAIGHT", "PREMUL") and image.colorspace_settings.name not in DATA
    return own and not node.outputs["Alpha"].is_linked


def texels_of(node, notes, name):
    """Colours of an Image Texture: linear RGB of (height, width, 3), the top row first. @throws NoPicture"""
    return pixels_of(node.image, notes, name, is_cut(node))


def pixels_of(image, notes, name, cut=False):
    """Linear RGB of (height, width, 3), the top row first. @param cut  whether times alpha   @throws NoPicture"""
    width, height = image.size
    if width == 0 or height == 0 or image.channels == 0:
        raise NoPicture(f"the image {image.name} has no pixels")
    raw = np.empty(width * height * image.channels, np.float32)
    image.pixels.foreach_get(raw)
    raw = raw.reshape(height, width, image.channels)[::-1]
    rgb = raw[..., :3] if image.channels >= 3 else np.repeat(raw[..., :1], 3, -1)
    if cut and image.channels == 4 and not (image.is_float and image.alpha_mode == "PREMUL"):
        rgb = rgb * raw[..., 3:]
    space = image.colorspace_settings.name
    # Pixels of bytes are in the file's colours, those of floats in the scene's.
    if image.is_float or space in LINEAR:
        return np.ascontiguousarray(rgb)
    if space not in SRGB:
        notes.say(name, f"the colour space {space} of the image {image.name} is taken as sRGB")
    return linear_from_srgb(rgb).astype(np.float32)


def alpha_of(image):
    """Of (height, width), the top row first. @throws NoPicture"""
    width, height = image.size
    if width == 0 or height == 0 or image.channels == 0:
        raise NoPicture(f"the image {image.name} has no pixels")
    if image.channels != 4 or image.alpha_mode == "NONE":
        return np.ones((height, width), np.float32)
    raw = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(raw)
    return np.ascontiguousarray(raw.reshape(height, width, 4)[::-1, :, 3])


def file_of(image):
    """Path of an image's own file; None: it is packed, generated or changed, or there is none."""
    if image.source != "FILE" or image.packed_file is not None or image.is_dirty or not image.filepath:
        return None
    path = os.path.abspath(bpy.path.abspath(image.filepath, library=image.library))
    return path if os.path.isfile(path) else None


def looked_up(picture, u, v, repeat_v=False):
    """Bilinear; u wraps around. @param v  0 at the bottom, 1 on top"""
    height, width = picture.shape[:2]
    x, y = (u - np.floor(u)) * width - 0.5, (1 - v) * height - 0.5
    x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = (x - x0)[..., None], (y - y0)[..., None]

    def texel(dx, dy):
        row = (y0 + dy) % height if repeat_v else np.clip(y0 + dy, 0, height - 1)
        return picture[row, (x0 + dx) % width]

    return (texel(0, 0) * (1 - fx) + texel(1, 0) * fx) * (1 - fy) + (texel(0, 1) * (1 - fx) + texel(1, 1) * fx) * fy


def write_exr(path, picture):
    """Linear RGB of (height, width, 3), the top row first, as floats without compression."""
    height, width = picture.shape[:2]

    def attribute(name, kind, data):
        return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(data)) + data

    channels = b"".join(c + b"\0" + struct.pack("<iiii", 2, 0, 1, 1) for c in (b"B", b"G", b"R")) + b"\0"
    window = struct.pack("<iiii", 0, 0, width - 1, height - 1)
    header = struct.pack("<ii", 20000630, 2)
    header += attribute("channels", "chlist", channels) + attribute("compression", "compression", b"\0")
    header += attribute("dataWindow", "box2i", window) + attribute("displayWindow", "box2i", window)
    header += attribute("lineOrder", "lineOrder", b"\0") + attribute("pixelAspectRatio", "float", struct.pack("<f", 1))
    header += attribute("screenWindowCenter", "v2f", struct.pack("<ff", 0, 0))
    header += attribute("screenWindowWidth", "float", struct.pack("<f", 1)) + b"\0"
    line = 8 + 12 * width
    rows = np.empty((height, line), np.uint8)
    rows[:, :4] = np.arange(height, dtype="<i4")[:, None].view(np.uint8)
    rows[:, 4:8] = np.frombuffer(struct.pack("<i", 12 * width), np.uint8)
    planes = np.ascontiguousarray(picture[:, :, ::-1].transpose(0, 2, 1), "<f4")
    rows[:, 8:] = planes.reshape(height, -1).view(np.uint8)
    offsets = len(header) + 8 * height + line * np.arange(height, dtype="<u8")
    with open(path, "wb") as out:
        out.write(header + offsets.tobytes() + rows.tobytes())
