"""Names, types and voxel sizes of the grids in an OpenVDB file, read from its descriptors alone."""

import struct

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

    def skip_metadata(self):
        for _ in range(self.bounded("i")):
            self.name()
            self.name()
            self._file.seek(self.number("I"), 1)

    def seek(self, position):
        self._file.seek(position)


def grids(path):
    """{grid: what a voxel holds, as "float" or "vec3s"}, without asking OpenVDB, which a damaged file can end the whole of
    Blender in. @throws NotVdb; OSError"""
    found = {}
    for name, kind, _ in _descriptors(path):
        words = kind.split("_")
        found[name] = words[1] if words[0] == "Tree" and len(words) > 1 else kind
    return found


def voxel_sizes(path):
    """{grid: voxel size} of grids whose voxels are cubes along the axes. @throws NotVdb; OSError"""
    sizes = {}
    for name, _, stream in _descriptors(path):
        if stream.name() in ("UniformScaleMap", "UniformScaleTranslateMap"):
            sizes[name] = stream.number("d")
    return sizes


def _descriptors(path):
    """Name and type of each grid, and the stream where its transform begins. @throws NotVdb; OSError"""
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
        stream.skip_metadata()
        for _ in range(stream.bounded("i")):
            name = stream.name().split("\x1e")[0]
            kind = stream.name()
            stream.name()
            start, _, end = (stream.number("q") for _ in range(3))
            if not 0 < start < end <= whole:
                raise NotVdb("is cut off")
            stream.seek(start + 4)
            stream.skip_metadata()
            yield name, kind, stream
            stream.seek(end)
