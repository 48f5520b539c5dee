"""Image data of VTK, written here in every encoding that VTK has, becomes volumes with the same values and places."""

import base64
import importlib.util
import lzma
import os
import resource
import subprocess
import sys
import unittest
import zlib

import numpy as np

from support import SOURCE, Folder

SCRIPT = SOURCE / "apps/python/vti_to_vdb.py"
loader = importlib.util.spec_from_file_location("vti_to_vdb", SCRIPT)
script = importlib.util.module_from_spec(loader)
loader.loader.exec_module(script)
SIZES, ORIGIN, SPACING = (5, 4, 3), (1.0, 2.0, 3.0), (0.5, 0.25, 0.125)


def vdb():
    for name in ("pyopenvdb", "openvdb"):
        if importlib.util.find_spec(name):
            return importlib.import_module(name)
    return None


def array_text(values, kind, order, header, compressor):
    """A DataArray's bytes as VTK packs them: as base64, and raw."""
    data = values.astype(order + {"Float32": "f4", "Float64": "f8", "UInt8": "u1"}[kind]).tobytes()
    number = np.dtype(order + {"UInt32": "u4", "UInt64": "u8"}[header])
    if not compressor:
        whole = np.array([len(data)], number).tobytes() + data
        return base64.b64encode(whole), whole
    pack = {"vtkZLibDataCompressor": zlib.compress, "vtkLZMADataCompressor": lzma.compress}[compressor]
    size = 64
    blocks = [data[i:i + size] for i in range(0, len(data), size)]
    packed = [pack(block) for block in blocks]
    last = len(data) % size
    head = np.array([len(blocks), size, last, *map(len, packed)], number).tobytes()
    body = b"".join(packed)
    return base64.b64encode(head) + base64.b64encode(body), head + body


def image(arrays, form, kind="Float32", order="<", header="UInt32", compressor="", cells=False, extent=None):
    """A .vti: values of x, y, z or x, y, z, components."""
    extent = extent or (0, SIZES[0] - 1, 0, SIZES[1] - 1, 0, SIZES[2] - 1)
    if cells:
        extent = tuple(e + i % 2 for i, e in enumerate(extent))
    texts, appended = [], b""
    for name, values in arrays.items():
        rows = values.reshape(*values.shape[:3], -1).transpose(2, 1, 0, 3).ravel()
        head = f'<DataArray Name="{name}" type="{kind}" NumberOfComponents="{rows.size // values[..., 0].size if values.ndim == 4 else 1}"'
        coded, raw = array_text(rows, kind, order, header, compressor)
        if form == "ascii":
            texts.append(f'{head} format="ascii">{" ".join(map(repr, rows.tolist()))}</DataArray>')
        elif form == "binary":
            texts.append(f'{head} format="binary">\n  {coded.decode()}\n</DataArray>')
        else:
            texts.append(f'{head} format="appended" offset="{len(appended)}"/>')
            appended += raw if form == "raw" else coded
    inside = "CellData" if cells else "PointData"
    box = " ".join(map(str, extent))
    names = {"<": "LittleEndian", ">": "BigEndian"}
    text = (f'<?xml version="1.0"?>\n<VTKFile type="ImageData" version="1.0" byte_order="{names[order]}" '
            f'header_type="{header}"' + (f' compressor="{compressor}"' if compressor else "") +
            f'>\n<ImageData WholeExtent="{box}" Origin="{" ".join(map(str, ORIGIN))}" '
            f'Spacing="{" ".join(map(str, SPACING))}">\n<Piece Extent="{box}"><{inside}>{"".join(texts)}'
            f'</{inside}></Piece></ImageData>').encode()
    if form in ("raw", "base64"):
        text += f'<AppendedData encoding="{form}">\n_'.encode() + appended + b"\n</AppendedData>"
    return text + b"</VTKFile>\n"


@unittest.skipUnless(vdb(), "no OpenVDB for Python")
class ImageDataOfVtk(Folder):
    def convert(self, *arguments, fails=False):
        ran = subprocess.run([sys.executable, SCRIPT, *map(str, arguments)], capture_output=True, text=True)
        self.assertEqual(ran.returncode, 2 if fails else 0, ran.stderr)
        return ran.stderr if fails else ran.stdout

    def grids(self, text):
        path = self.folder / "a.vti"
        path.write_bytes(text)
        return {grid.name: grid for grid in script.grids_of(script.Image(path), {}, 0, vdb())[0]}

    def setUp(self):
        super().setUp()
        rng = np.random.default_rng(3)
        self.density = np.round(rng.random(SIZES) * 8).astype(np.float32)  # exact in any type
        self.velocity = np.round(rng.random((*SIZES, 3)) * 8).astype(np.float32)

    def check(self, grids):
        found = np.zeros(SIZES, np.float32)
        grids["rho"].copyToArray(found)
        np.testing.assert_array_equal(found, self.density)
        found = np.zeros((*SIZES, 3), np.float32)
        grids["U"].copyToArray(found)
        np.testing.assert_array_equal(found, self.velocity)
        for index in ((0, 0, 0), (4, 3, 2)):
            np.testing.assert_allclose(grids["rho"].transform.indexToWorld(index),
                                       np.array(ORIGIN) + np.array(SPACING) * index)

    def test_every_encoding_holds_the_same(self):
        arrays = {"rho": self.density, "U": self.velocity}
        for form in ("ascii", "binary", "raw", "base64"):
            for compressor in ("", "vtkZLibDataCompressor", "vtkLZMADataCompressor"):
                for order, header, kind in (("<", "UInt32", "Float32"), (">", "UInt64", "Float64"),
                                            ("<", "UInt64", "UInt8")):
                    with self.subTest(form=form, compressor=compressor, order=order, kind=kind):
                        self.check(self.grids(image(arrays, form, kind, order, header, compressor)))

    def test_cells_stand_in_their_middles(self):
        grids = self.grids(image({"rho": self.density}, "raw", cells=True))
        found = np.zeros(SIZES, np.float32)
        grids["rho"].copyToArray(found)
        np.testing.assert_array_equal(found, self.density)
        np.testing.assert_allclose(grids["rho"].transform.indexToWorld((0, 0, 0)),
                                   np.array(ORIGIN) + 0.5 * np.array(SPACING))

    def test_pieces_are_joined_and_grids_renamed(self):
        half = (0, 2, 0, 3, 0, 2), (2, 4, 0, 3, 0, 2)  # both hold the plane between them
        for number, (extent, values) in enumerate(zip(half, (self.density[:3], self.density[2:]))):
            (self.folder / f"part{number}.vti").write_bytes(image({"rho": values}, "binary", extent=extent))
        pieces = "".join(f'<Piece Extent="{" ".join(map(str, e))}" Source="part{i}.vti"/>' for i, e in enumerate(half))
        (self.folder / "all.pvti").write_text(
            f'<VTKFile type="PImageData"><PImageData WholeExtent="0 4 0 3 0 2" Origin="1 2 3" '
            f'Spacing="0.5 0.25 0.125">{pieces}</PImageData></VTKFile>')
        self.convert(self.folder / "all.pvti", "--grid", "rho=density", "-o", self.folder / "out.vdb")
        found = np.zeros(SIZES, np.float32)
        vdb().read(str(self.folder / "out.vdb"), "density").copyToArray(found)
        np.testing.assert_array_equal(found, self.density)
        program = subprocess.run([os.environ["BRUME_PROGRAM"], "info", self.folder / "out.vdb"], capture_output=True,
                                 text=True, check=True)
        self.assertIn("voxel size    0.5 0.25 0.125", program.stdout)

    def test_what_is_wrong_is_said(self):
        def said(text, *arguments):
            path = self.folder / "wrong.vti"
            path.write_bytes(text)
            return self.convert(path, *arguments, fails=True)

        right = image({"rho": self.density}, "raw")
        self.assertIn("is no XML of VTK", said(b"hello"))
        self.assertIn("no array 'T'; there are rho", said(right, "--grid", "T"))
        self.assertIn("truncated", said(right[:-200] + b"</AppendedData></VTKFile>"))
        self.assertIn("compressed by vtkLZ4DataCompressor; known: vtkZLib",
                      said(right.replace(b"header_type", b'compressor="vtkLZ4DataCompressor" header_type')))
        self.assertIn("is UnstructuredGrid, expected ImageData", said(right.replace(b'"ImageData"', b'"UnstructuredGrid"')))
        self.assertIn("no such file", self.convert(self.folder / "none.vti", fails=True))

        def changed(old, new, expected):
            self.assertIn(old, right)
            path = self.folder / "wrong.vti"
            path.write_bytes(right.replace(old, new))
            with self.assertRaises(script.Problem) as raised:
                script.Image(path)
            self.assertTrue(str(raised.exception).startswith(f"{path}: "), raised.exception)
            self.assertIn(expected, str(raised.exception))

        self.assertIn('header_type="Foo", expected UInt32', said(right.replace(b'"UInt32"', b'"Foo"')))
        changed(b'"UInt32"', b'"Foo"', 'header_type="Foo", expected UInt32 or UInt64')
        changed(b' Extent="0 4 0', b' Extent="0 x 0', '<Piece> has Extent="0 x 0 3 0 2", expected six whole numbers')
        changed(b' Extent="0 4 0', b' Extent="1 5 0',
                'Extent="1 5 0 3 0 2", expected it inside of WholeExtent="0 4 0 3 0 2"')
        changed(b'WholeExtent="0 4', b'WholeExtent="0 99999999999', "expected six whole numbers")
        changed(b'WholeExtent="0 4 0 3', b'WholeExtent="0 999999999 0 999999999', "the memory of this machine")
        changed(b'WholeExtent="0 4', b'WholeExtent="4 0', "expected no number below the one before")
        changed(b'Origin="1.0 2.0 3.0"', b'Origin="0 0 a"', 'has Origin="0 0 a", expected 3 numbers')
        changed(b'Origin="1.0 2.0 3.0"', b'Origin="0 0"', 'has Origin="0 0", expected 3 numbers')
        changed(b"Origin=", b'Direction="1 0 0 0 1 0" Origin=', "expected 9 numbers")
        changed(b"Origin=", b'Direction="1 0 0 0 1 0 0 0 0" Origin=', "expected axes that span a space")
        changed(b'NumberOfComponents="1"', b'NumberOfComponents="one"', "expected a whole number above 0")

    def test_what_is_wrong_with_pieces_is_said(self):
        def said(*pieces):
            listed = "".join(f'<Piece Extent="0 4 0 3 0 2" {piece}/>' for piece in pieces)
            (self.folder / "all.pvti").write_text(f'<VTKFile type="PImageData"><PImageData WholeExtent="0 4 0 3 0 2">'
                                                  f'{listed}</PImageData></VTKFile>')
            return self.convert(self.folder / "all.pvti", fails=True)

        (self.folder / "one.vti").write_bytes(image({"rho": self.density}, "raw"))
        (self.folder / "three.vti").write_bytes(image({"rho": self.velocity}, "raw"))
        (self.folder / "none.vti").write_text('<VTKFile type="ImageData"/>')
        self.assertIn("all.pvti: a <Piece> has no Source", said(""))
        self.assertIn('Source="absent.vti", expected a file that is there', said('Source="absent.vti"'))
        self.assertIn("none.vti: has no <ImageData>", said('Source="none.vti"'))
        self.assertIn("three.vti: array 'rho' has NumberOfComponents=\"3\", expected 1",
                      said('Source="one.vti"', 'Source="three.vti"'))
        self.assertIn("none.vti: has no <ImageData>", self.convert(self.folder / "none.vti", fails=True))

    def test_no_file_is_written_twice_or_in_part(self):
        for folder in ("a", "b"):
            (self.folder / folder).mkdir()
            (self.folder / folder / "smoke.vti").write_bytes(image({"rho": self.density}, "raw"))
        out = self.folder / "out"
        told = self.convert(self.folder / "a/smoke.vti", self.folder / "b/smoke.vti", "-o", out, fails=True)
        self.assertIn("would both be written as", told)
        self.assertFalse(out.exists())
        (out / "smoke.vdb").mkdir(parents=True)  # no file can take its name
        self.convert(self.folder / "a/smoke.vti", "-o", out, fails=True)
        self.assertEqual([path.name for path in out.iterdir()], ["smoke.vdb"])

    def test_a_full_disk_leaves_the_file_that_was_there(self):
        (self.folder / "smoke.vti").write_bytes(image({"rho": self.density}, "raw"))
        (self.folder / "smoke.vdb").write_bytes(b"old")
        for most in (0, 400):
            ran = subprocess.run([sys.executable, SCRIPT, self.folder / "smoke.vti"], capture_output=True, text=True,
                                 preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (most, most)))
            self.assertEqual(ran.returncode, 2, ran.stderr)
            self.assertIn("expected space for it", ran.stderr)
            self.assertEqual((self.folder / "smoke.vdb").read_bytes(), b"old")
            self.assertEqual(sorted(path.name for path in self.folder.iterdir()), ["smoke.vdb", "smoke.vti"])


if __name__ == "__main__":
    unittest.main()
