"""Names, types, voxel sizes and boxes of the grids in an OpenVDB file, read from its descriptors alone."""

import struct

import numpy as np

MAGIC = 0x56444220
LARGEST = 1 << 16  # bytes of a name, entries of a table: what is larger is damage


class NotVdb(Exception):
    """What is wrong with a file."""


class _Stream:
    def __init__(self, file):
        self._file = file

    def number(self, form):
        size = struct.calcsize("<" + form)
        data = self._file.read(size)
        if len(data) < size:
            raise NotVdb("is cut off")
        return struct.unpack("<" + form, data)[0]

    def bounded(self, form="I"):
        count = self.number(form)
        if not 0 <= count <= LARGEST:
            raise NotVdb("is damaged")
        return count

    def name(self):
        return self._file.read(self.bounded()).decode("utf-8", "replace")

    def metadata(self):
        """{name: bytes} of the entries of at most 16 bytes."""
        found = {}
        for _ in range(self.bounded("i")):
            key, _, size = self.name(), self.name(), self.number("I")
            if size <= 16:
                found[key] = self._file.read(size)
            else:
                self._file.seek(size, 1)
        return found

    def numbers(self, count):
        return np.array([self.number("d") for _ in range(count)])

    def seek(self, position):
        self._file.seek(position)


def grids(path):
    """{grid: what a voxel holds, as "float" or "vec3s"}, without asking OpenVDB, which a damaged file can end the whole of
    Blender in. @throws NotVdb; OSError"""
    found = {}
    for name, kind, *_ in _descriptors(path):
        words = kind.split("_")
        found[name] = words[1] if words[0] == "Tree" and len(words) > 1 else kind
    return found


def voxel_sizes(path):
    """{grid: voxel size} of grids whose voxels are cubes along the axes. @throws NotVdb; OSError"""
    found = {}
    for name, _, _, stream in _descriptors(path):
        linear, _ = _transform(stream)
        if linear is not None and np.array_equal(linear, linear[0, 0] * np.eye(3)):
            found[name] = float(linear[0, 0])
    return found


def boxes(path):
    """{grid: the eight corners of its active voxels, (8, 3), in the file's space} of the grids that tell. @throws NotVdb; OSError"""
    found = {}
    for name, _, metadata, stream in _descriptors(path):
        linear, offset = _transform(stream)
        ends = [metadata.get("file_bbox_" + end, b"") for end in ("min", "max")]
        if linear is None or any(len(end) != 12 for end in ends):
            continue
        lo, hi = (np.array(struct.unpack("<3i", end), float) for end in ends)
        if np.any(lo > hi):  # an empty grid's
            continue
        lo, hi = lo - 0.5, hi + 0.5  # voxels' values are those at their middles
        corners = np.array([[(lo, hi)[i >> axis & 1][axis] for axis in range(3)] for i in range(8)])
        found[name] = corners @ linear + offset
    return found


def _transform(stream):
    """Of rows: world = index * linear + offset; (None, None) of one that is no affine map. @throws NotVdb"""
    kind = stream.name()
    if kind in ("UniformScaleMap", "ScaleMap"):
        return np.diag(stream.numbers(3)), np.zeros(3)
    if kind in ("UniformScaleTranslateMap", "ScaleTranslateMap"):
        offset = stream.numbers(3)
        return np.diag(stream.numbers(3)), offset
    if kind == "TranslationMap":
        return np.eye(3), stream.numbers(3)
    if kind in ("AffineMap", "UnitaryMap"):
        matrix = stream.numbers(16).reshape(4, 4)
        return matrix[:3, :3], matrix[3, :3]
    return None, None


def _descriptors(path):
    """Name, type and metadata of each grid, and the stream where its transform begins. @throws NotVdb; OSError"""
    with open(path, "rb") as file:
        whole = file.seek(0, 2)
        file.seek(0)
        stream = _Stream(file)
        if stream.number("q") != MAGIC:
            raise NotVdb("is no OpenVDB file")
        version = stream.number("I")
        if version < 222:
            raise NotVdb(f"is of the old version {version}")
        file.seek(8 + 1 + 36, 1)  # the library's version, whether grids have offsets, an identifier
        stream.metadata()
        for _ in range(stream.bounded("i")):
            name = stream.name().split("\x1e")[0]
            kind = stream.name()
            stream.name()
            start, _, end = (stream.number("q") for _ in range(3))
            if not 0 < start < end <= whole:
                raise NotVdb("is cut off")
            stream.seek(start + 4)
            yield name, kind, stream.metadata(), stream
            stream.seek(end)
