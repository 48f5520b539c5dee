"""Pictures as arrays: Blender's images, files that brume reads, look-ups."""

import contextlib
import itertools
import os
import struct

import bpy
import numpy as np

from .colour import linear_from_srgb

LINEAR = ("Linear", "Linear Rec.709", "scene_linear", "Raw", "Non-Color", "Generic Data")
DATA = ("Raw", "Non-Color", "Generic Data")
SRGB = ("sRGB", "Filmic sRGB")
MOST_SAMPLES = 1 << 18  # of a picture's texels, where a mean is asked for
WRITTEN_AT_ONCE = 1 << 19  # texels that are written at once
MAGENTA = [1, 0, 1, 1]  # Cycles' stand-in for images that are not there


def is_linear(image):
    return image.colorspace_settings.name in LINEAR


def moves(image):
    """Whether it is another one at other frames."""
    return image.source in ("SEQUENCE", "MOVIE")


def repair(values):
    """Makes NaN 0 and infinity the largest of the other values, as brume does to files that it reads. @return how many there were"""
    count = values.size - int(np.count_nonzero(np.isfinite(values)))
    if count:
        largest = values.max(initial=0, where=np.isfinite(values))
        np.nan_to_num(values, copy=False, nan=0, posinf=largest, neginf=0)
    return count


def repaired_text(count):
    return f"has {count} values that are no finite numbers: NaN became 0, infinity the largest of the others"


def is_cut(node, picture):
    """Whether the colours of an Image Texture are times its picture's alpha: where its own Alpha is not used."""
    own = picture.channels == 4 and picture.alpha_mode in ("STRAIGHT", "PREMUL") and picture.space not in DATA
    return own and not next(output for output in node.outputs if output.name == "Alpha").is_linked


class Pictures:
    """Of Blender's images, each read once, until it is forgotten or others need the room."""

    MOST = 1 << 30  # bytes

    def __init__(self):
        self._known = {}  # by name, the latest last
        self._serials, self._numbers = {}, itertools.count()  # by name: (number, whether the image moves)

    def of(self, image):
        """@param image  of Blender's, a Picture already, or None, of an Image Texture that has none"""
        if image is None or isinstance(image, Picture):
            return image or Picture(None)
        picture = self._known.pop(image.name_full, None)
        if picture is not None and not picture.is_of(image):
            picture = None
            self._serials.pop(image.name_full, None)
        picture = picture or Picture(image)
        self._known[image.name_full] = picture
        total = 0
        for name, other in reversed(list(self._known.items())):
            total += other.bytes()
            if total > self.MOST and other is not picture:
                del self._known[name]
        return picture

    def serials(self, images):
        """Numbers of images, for keys of what is made of them: others once they were forgotten, the same where only room was needed."""
        return tuple(self._serials.setdefault(image.name_full, (next(self._numbers), moves(image)))[0] for image in images)

    def forget(self):
        self._known, self._serials = {}, {}

    def forget_moving(self):
        self._known = {name: picture for name, picture in self._known.items() if not picture.moves}
        self._serials = {name: (number, moving) for name, (number, moving) in self._serials.items() if not moving}


class Picture:
    """An image of Blender's as it was when it was read: a thread may look at it while Blender's changes. Rows go from the top."""

    def __init__(self, image):
        (width, height), channels = (image.size, image.channels) if image is not None else ((0, 0), 0)  # which reads the file
        self.is_missing = width * height * channels == 0
        self.name, self._settings = image.name if image is not None else "", _settings_of(image)
        self.size, self.channels, self._is_float, self.alpha_mode, self.space, self.moves = self._settings
        if self.is_missing:
            raw = np.array(MAGENTA, np.float32)
        else:
            raw = np.empty(width * height * channels, np.float32)
            image.pixels.foreach_get(raw)
        self._repaired = 0
        if self._is_float:
            self._repaired = repair(raw)  # here, as look-ups between texels would smear it
        else:  # bytes in Blender, too
            raw *= 255
            raw += 0.5
            raw = raw.astype(np.uint8)
        self._raw = raw.reshape(self.size[1], self.size[0], self.channels)[::-1]
        self._linear = np.arange(256) / 255.0  # of a byte
        if self.space not in LINEAR:
            self._linear = linear_from_srgb(self._linear)
        self._linear = self._linear.astype(np.float32)

    def is_of(self, image):
        return self._settings == _settings_of(image)

    def bytes(self):
        return self._raw.nbytes

    def say_what_it_is(self, notes, name):
        if self.is_missing:
            notes.say(name, f"the image {self.name} is not there: it is magenta" if self.name else "an Image Texture has no image: it is magenta")
        elif not self._is_float and self.space not in LINEAR and self.space not in SRGB:
            notes.say(name, f"the colour space {self.space} of the image {self.name} is taken as sRGB")
        if self._repaired:
            notes.say(name, f"the image {self.name} {repaired_text(self._repaired)}")

    def some(self):
        """(rows, columns) of texels that are spread evenly: all of a small picture."""
        width, height = self.size
        step = max(int(np.ceil((width * height / MOST_SAMPLES) ** 0.5)), 1)
        return tuple(a.ravel() for a in np.meshgrid(np.arange(0, height, step), np.arange(0, width, step), indexing="ij"))

    def is_opaque(self):
        return not self._has_alpha() or bool((self._raw[..., 3] >= (1.0 if self._is_float else 255)).all())

    def looked_up(self, u, v, cut=False, repeat_v=False):
        """Linear RGB between texels, (N, 3); u wraps around. @param v  0 at the bottom, 1 on top"""
        return _between(lambda row, column: self.at(row, column, cut), *self.size, u, v, repeat_v)

    def alpha_looked_up(self, u, v):
        """(N,), repeated."""
        return _between(lambda row, column: self.alpha_at(row, column)[..., None], *self.size, u, v, True)[..., 0]

    def at(self, row, column, cut=False):
        """Linear RGB of texels, (N, 3). @param cut  whether times alpha"""
        raw = self._raw[row, column]
        rgb = raw[..., :3] if self.channels >= 3 else np.repeat(raw[..., :1], 3, -1)
        times_alpha = cut and self.channels == 4 and not (self._is_float and self.alpha_mode == "PREMUL")
        if self._is_float:  # in the scene's colours
            return rgb * raw[..., 3:] if times_alpha else rgb
        if not times_alpha:
            return self._linear[rgb]
        rgb = rgb / np.float32(255) * (raw[..., 3:] / np.float32(255))
        return rgb if self.space in LINEAR else linear_from_srgb(rgb).astype(np.float32)

    def _has_alpha(self):
        return self.channels == 4 and self.alpha_mode != "NONE"

    def alpha_at(self, row, column):
        """(N,)"""
        if not self._has_alpha():
            return np.ones(np.shape(row), np.float32)
        alpha = self._raw[row, column, 3]
        return alpha if self._is_float else alpha / np.float32(255)


def _settings_of(image):
    if image is None or image.size[0] * image.size[1] * image.channels == 0:
        return (1, 1), 4, True, "STRAIGHT", "Linear", False
    return tuple(image.size), image.channels, image.is_float, image.alpha_mode, image.colorspace_settings.name, moves(image)


def file_of(image):
    """Path of an image's own file; None: it is packed, generated or changed, or there is none."""
    if image.source != "FILE" or image.packed_file is not None or image.is_dirty or not image.filepath:
        return None
    path = os.path.abspath(bpy.path.abspath(image.filepath, library=image.library))
    return path if os.path.isfile(path) else None


def _between(texel, width, height, u, v, repeat_v):
    """Bilinear. @param texel  function of rows and columns: their values, (N, channels)"""
    x, y = (u - np.floor(u)) * width - 0.5, (1 - v) * height - 0.5
    x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = (x - x0)[..., None], (y - y0)[..., None]

    def at(dx, dy):
        row = (y0 + dy) % height if repeat_v else np.clip(y0 + dy, 0, height - 1)
        return texel(row, (x0 + dx) % width)

    return (at(0, 0) * (1 - fx) + at(1, 0) * fx) * (1 - fy) + (at(0, 1) * (1 - fx) + at(1, 1) * fx) * fy


def write_exr(path, picture, check=lambda: None):
    """Linear RGB of (height, width, 3), the top row first, as floats without compression. @param check  called several times a
    second; may throw, which leaves no file"""
    height, width = picture.shape[:2]
    try:
        with open(path, "wb") as out:
            header = _exr_header(width, height)
            line = 8 + 12 * width
            offsets = len(header) + 8 * height + line * np.arange(height, dtype="<u8")
            out.write(header + offsets.tobytes())
            band = max(WRITTEN_AT_ONCE // width, 1)
            for first in range(0, height, band):
                check()
                out.write(_scan_lines(picture[first : first + band], first))
    except BaseException:
        with contextlib.suppress(FileNotFoundError):
            os.remove(path)
        raise


def _scan_lines(picture, first):
    """Of rows from a number on: each one's number, size and channels."""
    height, width = picture.shape[:2]
    rows = np.empty((height, 8 + 12 * width), np.uint8)
    rows[:, :4] = np.arange(first, first + height, dtype="<i4")[:, None].view(np.uint8)
    rows[:, 4:8] = np.frombuffer(struct.pack("<i", 12 * width), np.uint8)
    planes = np.ascontiguousarray(picture[:, :, ::-1].transpose(0, 2, 1), "<f4")
    rows[:, 8:] = planes.reshape(height, -1).view(np.uint8)
    return rows.data


def _exr_header(width, height):
    def attribute(name, kind, data):
        return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(data)) + data

    channels = b"".join(c + b"\0" + struct.pack("<iiii", 2, 0, 1, 1) for c in (b"B", b"G", b"R")) + b"\0"
    window = struct.pack("<iiii", 0, 0, width - 1, height - 1)
    header = struct.pack("<ii", 20000630, 2)
    header += attribute("channels", "chlist", channels) + attribute("compression", "compression", b"\0")
    header += attribute("dataWindow", "box2i", window) + attribute("displayWindow", "box2i", window)
    header += attribute("lineOrder", "lineOrder", b"\0") + attribute("pixelAspectRatio", "float", struct.pack("<f", 1))
    header += attribute("screenWindowCenter", "v2f", struct.pack("<ff", 0, 0))
    return header + attribute("screenWindowWidth", "float", struct.pack("<f", 1)) + b"\0"
