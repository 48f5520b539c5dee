"""Reads the OpenEXR files that brume writes: one part of scan lines, uncompressed or packed by zlib.

Blender's own reader makes images of files; this one gives channels. Knows NumPy and nothing of Blender.
"""

import struct
import zlib

import numpy as np

MAGIC = 20000630
FLAGS_OF_OTHERS = 0x200 | 0x800 | 0x1000  # tiled, deep, several parts
MOST_PACKED = 1032  # bytes that zlib makes of one
LINES_OF = {0: 1, 2: 1, 3: 16}  # in a block, by compression: none, ZIPS, ZIP
NAME_OF = {0: "NONE", 1: "RLE", 2: "ZIPS", 3: "ZIP", 4: "PIZ", 5: "PXR24", 6: "B44", 7: "B44A", 8: "DWAA", 9: "DWAB"}
TYPES = {0: np.dtype("<u4"), 1: np.dtype("<f2"), 2: np.dtype("<f4")}


class NotReadable(Exception):
    """What is wrong with a file, with its name."""


class Frame:
    """Channels by name as arrays of rows from the top, float32, over the data window.

    x, y       the window's first pixel
    header     attributes of text, numbers and 4 x 4 matrices
    """

    def __init__(self, width, height, x, y, header):
        self.width, self.height, self.x, self.y, self.header = width, height, x, y, header
        self.channels = {}

    def layer(self, name, components):
        """An array height x width x components of a layer's channels; None where one is missing."""
        names = [f"{name}.{c}" if name else c for c in components]
        if any(n not in self.channels for n in names):
            return None
        return np.stack([self.channels[n] for n in names], axis=-1)


def read(path, wanted=None):
    """@param wanted  function of a channel's name; all are read without it
    @throws NotReadable"""
    try:
        with open(path, "rb") as file:
            data = file.read()
    except OSError as error:
        raise NotReadable(f"{path}: {error.strerror}") from None
    try:
        return _parse(data, path, wanted)
    except (struct.error, KeyError, IndexError, OverflowError, ValueError, zlib.error) as error:
        raise NotReadable(f"{path}: is damaged or not whole: {error}") from None


def _parse(data, path, wanted):
    magic, version = struct.unpack_from("<ii", data, 0)
    if magic != MAGIC:
        raise NotReadable(f"{path}: is no EXR file")
    if version & FLAGS_OF_OTHERS:
        raise NotReadable(f"{path}: is tiled, deep or of several parts; expected one part of scan lines")
    header, at = _header(data)
    compression = header["compression"][1][0]
    if compression not in LINES_OF:
        raise NotReadable(f"{path}: its compression is {NAME_OF.get(compression, compression)}; expected NONE, ZIPS or ZIP")
    x0, y0, x1, y1 = struct.unpack("<4i", header["dataWindow"][1])
    width, height = x1 - x0 + 1, y1 - y0 + 1
    if width < 1 or height < 1:
        raise ValueError(f"a window of {width} x {height}")
    frame = Frame(width, height, x0, y0, _attributes(header))
    channels = _channels(header["channels"][1], path)
    _read_blocks(data, at, frame, channels, LINES_OF[compression], wanted)
    return frame


def _text(data, at):
    end = data.index(0, at)
    return data[at:end].decode("utf-8", "replace"), end + 1


def _header(data):
    """Attributes as name: (type, bytes), and where they end."""
    found, at = {}, 8
    while data[at]:
        name, at = _text(data, at)
        kind, at = _text(data, at)
        (size,) = struct.unpack_from("<i", data, at)
        at += 4
        found[name] = (kind, data[at : at + size])
        at += size
    for name in ("channels", "compression", "dataWindow"):
        if name not in found:
            raise ValueError(f"no attribute '{name}'")
    return found, at + 1


def _attributes(header):
    formats = {"int": "<i", "float": "<f", "double": "<d", "m44f": "<16f"}
    values = {}
    for name, (kind, data) in header.items():
        if kind == "string":
            values[name] = data.decode("utf-8", "replace")
        elif kind == "m44f":
            values[name] = np.array(struct.unpack(formats[kind], data), np.float64).reshape(4, 4)
        elif kind in formats:
            values[name] = struct.unpack(formats[kind], data)[0]
    return values


def _channels(data, path):
    """Names and types, in the order in which a line has them."""
    found, at = [], 0
    while data[at]:
        name, at = _text(data, at)
        kind, _, x_step, y_step = struct.unpack_from("<iiii", data, at)
        at += 16
        if (x_step, y_step) != (1, 1):
            raise NotReadable(f"{path}: channel {name} has not every pixel")
        found.append((name, TYPES[kind]))
    return found


def _read_blocks(data, at, frame, channels, lines, wanted):
    line_size = frame.width * sum(kind.itemsize for _, kind in channels)
    if line_size * frame.height > MOST_PACKED * len(data):
        raise ValueError("more pixels than it can hold")
    read = {name for name, _ in channels if wanted is None or wanted(name)}
    for name in read:
        frame.channels[name] = np.zeros((frame.height, frame.width), np.float32)
    blocks = (frame.height + lines - 1) // lines
    for place in struct.unpack_from(f"<{blocks}Q", data, at):
        y, size = struct.unpack_from("<ii", data, place)
        row = y - frame.y
        count = min(lines, frame.height - row)
        block = data[place + 8 : place + 8 + size]
        if row < 0 or row >= frame.height or len(block) != size:
            raise ValueError("a block is missing")
        # What packing would not have made smaller is stored as it is.
        raw = block if size == line_size * count else _unpacked(block)
        if len(raw) != line_size * count:
            raise ValueError("a block has another size than its lines")
        _read_lines(raw, frame, channels, read, row, count, line_size)


def _unpacked(block):
    """Undoes what EXR does before zlib: differences between bytes, and the bytes of even and odd places apart."""
    packed = np.frombuffer(zlib.decompress(block), np.uint8).astype(np.uint8)
    packed[1:] -= 128
    sums = np.cumsum(packed, dtype=np.uint8)
    half = (len(sums) + 1) // 2
    out = np.empty_like(sums)
    out[0::2], out[1::2] = sums[:half], sums[half:]
    return out


def _read_lines(raw, frame, channels, read, row, count, line_size):
    lines = np.frombuffer(raw, np.uint8).reshape(count, line_size)
    at = 0
    for name, kind in channels:
        size = frame.width * kind.itemsize
        if name in read:
            frame.channels[name][row : row + count] = np.ascontiguousarray(lines[:, at : at + size]).view(kind)
        at += size
