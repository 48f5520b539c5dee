#!/usr/bin/python3
"""Writes the image data of VTK (.vti, and .pvti of several pieces) as OpenVDB files, which brume renders.

    vti_to_vdb.py smoke.vti                              # smoke.vdb, every array a grid of its name
    vti_to_vdb.py run/smoke_*.vti -o vdb                 # a sequence, into a folder
    vti_to_vdb.py run.vti --grid rho=density --grid U=velocity

Arrays of one component become grids of floats, those of three grids of vectors; others are told and left out. Values
of points stand where VTK has them, those of cells in the cells' middles. What is 0 takes no memory (--zero).

Needs NumPy and OpenVDB for Python (Debian: python3-numpy, python3-openvdb). VTK is not needed: ASCII, binary and
appended data are read, raw or base64, without compression or compressed by zlib or LZMA.
"""
import argparse
import base64
import lzma
import math
import os
import pathlib
import sys
import xml.etree.ElementTree
import zlib

import numpy as np

TYPES = {"Float32": "f4", "Float64": "f8", "Int8": "i1", "UInt8": "u1", "Int16": "i2", "UInt16": "u2", "Int32": "i4",
         "UInt32": "u4", "Int64": "i8", "UInt64": "u8"}
UNPACK = {"": None, "vtkZLibDataCompressor": zlib.decompress, "vtkLZMADataCompressor": lzma.decompress}
MOST = 2**31 - 1  # the largest index of OpenVDB


class Problem(Exception):
    """What is wrong with a file."""


class Blocks:
    """The bytes of arrays in one file."""

    def __init__(self, path):
        self.path = path
        text = path.read_bytes()
        # What is appended raw is no XML: it is cut out before the rest is parsed.
        self.appended, self.raw = b"", False
        begin = text.find(b"<AppendedData")
        if begin >= 0:
            start = text.find(b"_", text.find(b">", begin)) + 1
            end = text.rfind(b"</AppendedData>")
            if start == 0 or end < 0:
                raise Problem(f"{path}: its AppendedData has no end, or no _ before its bytes: truncated?")
            self.raw = b'"raw"' in text[begin:start]
            self.appended = text[start:end]
            text = text[:start - 1] + text[end:]
        try:
            self.root = xml.etree.ElementTree.fromstring(text)
        except (xml.etree.ElementTree.ParseError, ValueError, LookupError) as error:
            raise Problem(f"{path}: is no XML of VTK ({error})")
        if self.root.tag != "VTKFile":
            raise Problem(f"{path}: begins with <{self.root.tag}>, expected <VTKFile>")
        self.order = "<" if self.root.get("byte_order", "LittleEndian") == "LittleEndian" else ">"
        header = self.root.get("header_type", "UInt32")
        if header not in ("UInt32", "UInt64"):
            raise Problem(f"{path}: has header_type=\"{header}\", expected UInt32 or UInt64")
        self.header = np.dtype(self.order + TYPES[header])
        compressor = self.root.get("compressor", "")
        if compressor not in UNPACK:
            known = ", ".join(name for name in UNPACK if name)
            raise Problem(f"{path}: compressed by {compressor}; known: {known}, or none")
        self.unpack = UNPACK[compressor]

    def values(self, array, count):
        """The numbers of a DataArray."""
        name, kind = array.get("Name", ""), array.get("type", "")
        if kind not in TYPES:
            raise Problem(f"{self.path}: array '{name}' is of type {kind}; known: {', '.join(TYPES)}")
        form = array.get("format", "ascii")
        try:
            if form == "ascii":
                values = np.array((array.text or "").split(), dtype=float)
            elif form == "binary":
                values = self.decoded("".join((array.text or "").split()).encode(), self.order + TYPES[kind])
            else:
                data = self.appended[int(array.get("offset")):]
                values = self.uncovered(data, self.order + TYPES[kind]) if self.raw else self.decoded(
                    data, self.order + TYPES[kind])
        except (ValueError, TypeError, IndexError, OverflowError, EOFError, zlib.error, lzma.LZMAError) as error:
            raise Problem(f"{self.path}: array '{name}' cannot be read ({error}), expected {count} numbers")
        if values.size != count:
            raise Problem(f"{self.path}: array '{name}' holds {values.size} numbers, expected {count}")
        return values

    def decoded(self, text, dtype):
        """Base64: the lengths are encoded apart from what follows where that is compressed."""
        size = self.header.itemsize

        def encoded(count):
            return (count + 2) // 3 * 4

        if not self.unpack:
            head = text[:encoded(size)]
            length = int(np.frombuffer(base64.b64decode(head), self.header, 1)[0])
            if head.endswith(b"="):  # some programs encode the length apart, too
                rest = text[encoded(size):encoded(size) + encoded(length)]
                return self.uncovered(base64.b64decode(head) + base64.b64decode(rest), dtype)
            return self.uncovered(base64.b64decode(text[:encoded(size + length)]), dtype)
        blocks = int(np.frombuffer(base64.b64decode(text[:encoded(size)]), self.header, 1)[0])
        cut = encoded(size * (3 + blocks))
        header = base64.b64decode(text[:cut])
        packed = int(np.frombuffer(header, self.header, 3 + blocks)[3:].sum())
        return self.uncovered(header + base64.b64decode(text[cut:cut + encoded(packed)]), dtype)

    def uncovered(self, data, dtype):
        size = self.header.itemsize
        if not self.unpack:
            length = int(np.frombuffer(data, self.header, 1)[0])
            if len(data) < size + length:
                raise ValueError("truncated")
            return np.frombuffer(data[size:size + length], dtype)
        blocks = int(np.frombuffer(data, self.header, 1)[0])
        lengths = np.frombuffer(data, self.header, 3 + blocks)[3:]
        at, parts = size * (3 + blocks), []
        for length in lengths:
            parts.append(self.unpack(data[at:at + int(length)]))
            at += int(length)
        return np.frombuffer(b"".join(parts), dtype)


class Image:
    """The arrays of a file of one piece or several, each x, y, z or x, y, z, components."""

    def __init__(self, path):
        blocks = Blocks(path)
        kind = blocks.root.get("type")
        if kind not in ("ImageData", "PImageData"):
            raise Problem(f"{path}: is {kind}, expected ImageData: a grid of equal cells")
        top = blocks.root.find(kind)
        if top is None:
            raise Problem(f"{path}: has no <{kind}>, expected one in its <VTKFile>")
        self.path = path
        self.extent = extent_of(path, top, "WholeExtent")
        if (self.extent[:, 1] < self.extent[:, 0]).any():
            raise Problem(f"{path}: has WholeExtent=\"{text_of(self.extent)}\", expected no number below the one "
                          "before it on its axis")
        self.origin = numbers(path, top, "Origin", "0 0 0")
        self.spacing = numbers(path, top, "Spacing", "1 1 1")
        self.direction = numbers(path, top, "Direction", "1 0 0 0 1 0 0 0 1").reshape(3, 3)
        if not (self.spacing > 0).all():
            raise Problem(f"{path}: its spacing is {self.spacing}, expected lengths above 0")
        if abs(np.linalg.det(self.direction)) < 1e-6:
            raise Problem(f"{path}: has Direction=\"{top.get('Direction')}\", expected axes that span a space")
        self.arrays = {}  # name: values, and whether they are the cells'
        for piece in top.findall("Piece"):
            if kind == "ImageData":
                self.add(blocks, piece)
                continue
            source = piece.get("Source")
            if not source:
                raise Problem(f"{path}: a <Piece> has no Source, expected the name of a .vti")
            if not (path.parent / source).is_file():
                raise Problem(f"{path}: a <Piece> has Source=\"{source}\", expected a file that is there")
            part = Blocks(path.parent / source)
            image = part.root.find("ImageData")
            if image is None:
                raise Problem(f"{part.path}: has no <ImageData>, expected one: it is a piece of {path}")
            for own in image.findall("Piece"):
                self.add(part, own)
        if not self.arrays:
            raise Problem(f"{path}: holds no arrays")

    def add(self, blocks, piece):
        extent = extent_of(blocks.path, piece, "Extent")
        if (extent[:, 1] < extent[:, 0]).any():
            return  # VTK writes empty pieces where it has more processes than work
        if (extent[:, 0] < self.extent[:, 0]).any() or (extent[:, 1] > self.extent[:, 1]).any():
            raise Problem(f"{blocks.path}: a <Piece> has Extent=\"{text_of(extent)}\", expected it inside of "
                          f"WholeExtent=\"{text_of(self.extent)}\"")
        for tag, cells in (("PointData", 0), ("CellData", 1)):
            for array in piece.findall(f"{tag}/DataArray"):
                name, given = array.get("Name", tag), array.get("NumberOfComponents", "1")
                if not given.isdecimal() or int(given) == 0:
                    raise Problem(f"{blocks.path}: array '{name}' has NumberOfComponents=\"{given}\", expected a whole "
                                  "number above 0")
                parts = int(given)
                sizes = sizes_of(extent, cells)
                values = blocks.values(array, math.prod(sizes) * parts)
                values = values.reshape(sizes[2], sizes[1], sizes[0], parts).transpose(2, 1, 0, 3)
                if name not in self.arrays:
                    self.arrays[name] = self.zeros(name, cells, parts), cells
                into, others = self.arrays[name]
                if into.shape[3] != parts:
                    raise Problem(f"{blocks.path}: array '{name}' has NumberOfComponents=\"{parts}\", expected "
                                  f"{into.shape[3]} as in what came before")
                if others != cells:
                    raise Problem(f"{blocks.path}: array '{name}' is of points and of cells, expected one of them")
                lo = extent[:, 0] - self.extent[:, 0]
                into[lo[0]:lo[0] + sizes[0], lo[1]:lo[1] + sizes[1], lo[2]:lo[2] + sizes[2]] = values

    def zeros(self, name, cells, parts):
        whole = sizes_of(self.extent, cells)
        need, have = math.prod(whole) * parts * 4, os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
        try:
            if need > have:
                raise MemoryError  # the system may grant it all the same, and end this program when it is used
            return np.zeros((*whole, parts), np.float32)
        except MemoryError:
            raise Problem(f"{self.path}: array '{name}' takes {need} bytes by WholeExtent=\"{text_of(self.extent)}\", "
                          f"expected at most the memory of this machine, {have}")

    def world_from_index(self, cells):
        """Rows of OpenVDB's matrix: points are rows there."""
        axes = self.direction * self.spacing  # columns: steps along i, j, k
        corner = self.origin + axes @ (self.extent[:, 0] + 0.5 * cells)
        matrix = np.eye(4)
        matrix[:3, :3], matrix[3, :3] = axes.T, corner
        return matrix


def numbers(path, element, key, default):
    given, count = element.get(key, default), len(default.split())
    try:
        found = np.array(given.split(), dtype=float)
    except ValueError:
        found = np.empty(0)
    if found.size != count or not np.isfinite(found).all():
        raise Problem(f"{path}: <{element.tag}> has {key}=\"{given}\", expected {count} numbers")
    return found


def extent_of(path, element, key):
    given = element.get(key, "")
    try:
        extent = np.array([int(word) for word in given.split()], dtype=np.int64)
    except (ValueError, OverflowError):
        extent = np.empty(0)
    if extent.size != 6 or (np.abs(extent) > MOST).any():
        raise Problem(f"{path}: <{element.tag}> has {key}=\"{given}\", expected six whole numbers")
    return extent.reshape(3, 2)


def text_of(extent):
    return " ".join(map(str, extent.ravel()))


def sizes_of(extent, cells):
    """How many values stand along each axis, as Python's integers, which do not overflow."""
    return [int(size) + 1 - cells for size in extent[:, 1] - extent[:, 0]]


def grids_of(image, names, zero, vdb):
    """@return OpenVDB's grids, and lines on what was left out"""
    missing = [name for name in names if name not in image.arrays]
    if missing:
        raise Problem(f"no array '{missing[0]}'; there are {', '.join(sorted(image.arrays))}")
    grids, notes = [], []
    for name, (values, cells) in image.arrays.items():
        parts = values.shape[3]
        if names and name not in names:
            continue
        if parts not in (1, 3):
            notes.append(f"array '{name}' has {parts} components: left out")
            continue
        grid = vdb.FloatGrid() if parts == 1 else vdb.Vec3SGrid()
        scalar = values[..., 0] if parts == 1 else values
        scalar = np.where(np.abs(scalar) <= zero, np.float32(0), scalar)
        grid.copyFromArray(np.ascontiguousarray(scalar), tolerance=0 if parts == 1 else (0, 0, 0))
        grid.name = names.get(name, name)
        if parts == 1:
            grid.gridClass = vdb.GridClass.FOG_VOLUME
        grid.transform = vdb.createLinearTransform(image.world_from_index(cells).tolist())
        grids.append(grid)
    return grids, notes


def write_whole(target, grids, vdb):
    """The file appears under its name once all of it is written."""
    target.parent.mkdir(parents=True, exist_ok=True)
    partial = target.with_name(f".{target.stem}.{os.getpid()}.partial.vdb")
    try:
        vdb.write(str(partial), grids=grids)
        # OpenVDB says nothing of a disk that is full; what it reads at once, not when it is used, shows it.
        os.environ["OPENVDB_DISABLE_DELAYED_LOAD"] = "1"
        try:
            vdb.readAll(str(partial))
        except (OSError, RuntimeError, LookupError) as error:
            raise Problem(f"cannot write {target} whole ({error}); expected space for it on its disk")
        os.replace(partial, target)
    finally:
        partial.unlink(missing_ok=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", nargs="+", type=pathlib.Path, help=".vti or .pvti")
    parser.add_argument("-o", "--output", type=pathlib.Path, help="a .vdb for one file, or a folder")
    parser.add_argument("--grid", action="append", default=[], metavar="ARRAY[=NAME]",
                        help="take this array alone, as a grid of that name; again for more")
    parser.add_argument("--zero", type=float, default=0, help="values up to this size count as 0")
    options = parser.parse_args()
    try:
        import pyopenvdb as vdb
    except ImportError:
        try:
            import openvdb as vdb
        except ImportError:
            parser.exit(2, "vti_to_vdb: there is no OpenVDB for this Python; Debian has it as python3-openvdb\n")
    names = dict((text.split("=", 1) * 2)[:2] for text in options.grid)
    output = options.output
    if output and output.suffix == ".vdb" and len(options.file) > 1:
        parser.exit(2, f"vti_to_vdb: {output} is one file, of {len(options.file)}; expected a folder\n")
    targets = {}  # target: its input
    for path in options.file:
        target = path.with_suffix(".vdb")
        if output:
            target = output if output.suffix == ".vdb" else output / target.name
        if target in targets:
            parser.exit(2, f"vti_to_vdb: {targets[target]} and {path} would both be written as {target}; expected "
                           "inputs of different names\n")
        targets[target] = path
    for target, path in targets.items():
        try:
            if not path.is_file():
                raise Problem(f"{path}: no such file")
            grids, notes = grids_of(Image(path), names, options.zero, vdb)
            for note in notes:
                print(f"vti_to_vdb: {path}: {note}", file=sys.stderr)
            if not grids:
                raise Problem(f"{path}: holds no array of 1 or 3 components")
            write_whole(target, grids, vdb)
            print(target)
        except Problem as problem:
            text = str(problem)
            parser.exit(2, f"vti_to_vdb: {text if text.startswith(str(path)) else f'{path}: {text}'}\n")
        except MemoryError as error:
            parser.exit(2, f"vti_to_vdb: {path}: takes more memory than there is ({error})\n")
        except OSError as error:
            parser.exit(2, f"vti_to_vdb: {error}\n")


if __name__ == "__main__":
    main()
