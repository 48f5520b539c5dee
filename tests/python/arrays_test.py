"""Volumes and meshes given as arrays: where their values sit, and that nothing but the values counts."""

import logging
import unittest

import numpy as np

import brume
from support import Folder, assert_same_pixels, cloud_array

try:
    import pyopenvdb
except ImportError:  # Debian's python3-openvdb
    pyopenvdb = None

BASE = {"camera": {"position": [1.0, -8.0, 3.0], "look_at": [1.8, 1.2, 1.5], "fov": 40.0, "shutter": [-0.25, 0.25]},
        "film": {"width": 32, "height": 24},
        "environment": {"radiance": [0.5, 0.6, 0.7]},
        "lights": [{"type": "sun", "direction": [1.0, -1.0, 2.0], "irradiance": 3.0}]}


def scene(*volumes, **tables):
    return {**BASE, "volumes": list(volumes), **tables}


def seen_along(axis, up, density, **volume):
    """Optical depth of a volume on a screen of 12 x 12 units, 4 pixels each, around (6, 6, 6)."""
    position = np.full(3, 6.0)
    position[axis] -= 50
    direction = np.zeros(3)
    direction[up] = 1
    return brume.render(
        {"camera": {"type": "orthographic", "position": position, "look_at": [6.0, 6.0, 6.0], "up": direction, "width": 12.0},
         "film": {"width": 48, "height": 48}, "environment": {"radiance": 1.0}, "volumes": [{"density": density, "sigma_t": 1.0, **volume}]},
        spp=16, layers="optical_depth", statistics=False)["optical_depth.Y"]


class Places(unittest.TestCase):
    def test_a_value_sits_at_the_corner_that_its_indices_name(self):
        density = np.zeros((9, 7, 8))
        density[5, 3, 4] = 0.5
        to_middle = (np.arange(48) + 0.5) / 4
        for volume, centre, voxel in (
            ({}, (5, 3, 4), 1.0),
            ({"origin": [1.0, 2.0, 3.0]}, (6, 5, 7), 1.0),
            ({"voxel_size": 0.5, "origin": [3.0, 3.0, 3.0]}, (5.5, 4.5, 5), 0.125),
            ({"voxel_size": [2.0, 1.0, 0.5], "index_offset": [0.0, 1.0, 0.0]}, (10, 4, 2), 1.0),
        ):
            # Of the value's trilinear tent, whose integral is the value times the voxel's volume.
            picture = seen_along(0, 2, density, **volume)  # looking along x, y is to the left, z up
            whole = picture.sum()
            self.assertAlmostEqual(whole / 16, 0.5 * voxel, delta=0.02 * voxel)
            self.assertAlmostEqual(12 - picture.sum(axis=0) @ to_middle / whole, centre[1], delta=0.05)
            self.assertAlmostEqual(12 - picture.sum(axis=1) @ to_middle / whole, centre[2], delta=0.05)
            picture = seen_along(1, 2, density, **volume)  # looking along y, x is to the right
            self.assertAlmostEqual(picture.sum(axis=0) @ to_middle / picture.sum(), centre[0], delta=0.05)

    def test_a_matrix_places_the_array(self):
        density = cloud_array()
        turned = np.array([[0.0, -0.1, 0.0, 2.0], [0.1, 0.0, 0.0, 0.5], [0.0, 0.0, 0.1, 0.25], [0.0, 0.0, 0.0, 1.0]])
        a = brume.render(scene({"density": density, "sigma_t": 5.0, "object_to_world": turned}), spp=4)
        b = brume.render(scene({"density": np.rot90(density, axes=(0, 1)), "sigma_t": 5.0, "voxel_size": 0.1,
                                "origin": [2.0 - 0.1 * (density.shape[1] - 1), 0.5, 0.25]}), spp=4)
        np.testing.assert_allclose(a.image("transmittance").mean(), b.image("transmittance").mean(), rtol=0.02)

    def test_a_furnace_of_any_array_is_white(self):
        volume = {"density": cloud_array(), "sigma_t": 8.0, "albedo": 1.0, "voxel_size": 0.2}
        white = brume.render(scene(volume, environment={"radiance": 1.0}, lights=[]), spp=8)
        np.testing.assert_allclose(white.image(), 1, rtol=1e-5)


class Values(unittest.TestCase):
    def setUp(self):
        self.density = np.round(cloud_array() * 8).astype(np.float32)
        self.expected = brume.render(scene({"density": self.density, "sigma_t": 0.7}), spp=2)

    def found(self, density, **volume):
        return brume.render(scene({"density": density, "sigma_t": 0.7, **volume}), spp=2)

    def test_the_kind_of_number_and_the_order_in_memory_change_nothing(self):
        d = self.density
        wide = np.zeros((d.shape[0], 2 * d.shape[1], d.shape[2] + 3))
        wide[:, ::2, 3:] = d
        unaligned = np.frombuffer(b"." + d.tobytes(), np.uint8)[1:].view(np.float32).reshape(d.shape)
        for array in (d.astype(np.float64), d.astype(np.float16), d.astype(np.uint8), d.astype(np.int64),
                      d.astype(">f4"), d.astype(">f8"), np.asfortranarray(d), wide[:, ::2, 3:], d[::-1][::-1].copy()[::1],
                      np.flip(np.ascontiguousarray(np.flip(d))), unaligned, d.tolist()):
            assert_same_pixels(self, self.found(array), self.expected)
        booleans = d > 3
        assert_same_pixels(self, self.found(booleans), self.found(booleans.astype(np.float32)))

    def test_only_real_numbers_of_three_axes_are_taken(self):
        d = self.density
        with self.assertRaisesRegex(TypeError, r"volumes.0.density: expected real numbers, found complex64"):
            self.found(d.astype(np.complex64))
        with self.assertRaisesRegex(TypeError, "found object"):
            self.found(d.astype(object))
        for wrong, words in ((d[0], "expected x, y, z, found 14 x 18"), (d[..., None], "found 12 x 14 x 18 x 1"),
                             (d[:0], "expected voxels, found 0 x")):
            with self.assertRaisesRegex(brume.InputError, r"volumes.0.density: .*" + words):
                self.found(wrong)
        with self.assertRaisesRegex(brume.InputError, r"volumes.0.velocity: expected x, y, z, 3, found 12 x 14 x 18"):
            self.found(d, velocity=d)
        with self.assertRaisesRegex(brume.InputError, r"volumes.0.flame: 11 x 14 x 18 voxels, its density has 12 x 14 x 18"):
            self.found(d, flame=d[1:])
        with self.assertRaisesRegex(brume.InputError, "volumes.0: no array 'densty'; did you mean 'density'"):
            brume.Scene(scene({"densty": d}))
        with self.assertRaisesRegex(brume.InputError, "'grid' stands beside arrays"):
            self.found(d, grid="density")
        with self.assertRaisesRegex(brume.InputError, "arrays stand beside shape"):
            self.found(d, shape="box")
        with self.assertRaisesRegex(brume.InputError, "volumes.1: arrays, but the scene has 1 volumes"):
            brume.Scene(scene({"density": d})).render(volumes__1__density=d)
        with self.assertRaisesRegex(brume.InputError, "unknown key 'voxel_size'"):
            brume.Scene(scene({"shape": "box", "voxel_size": 2.0}))

    def test_what_is_no_density_counts_as_none_and_is_told(self):
        d = self.density
        marked = d.copy()
        marked[0, 0, :5] = [np.nan, -1, np.inf, -np.inf, 0]
        meant = d.copy()
        meant[0, 0, :5] = [0, 0, d.max(), 0, 0]
        with self.assertLogs("brume", logging.WARNING) as told:
            found = self.found(marked)
        assert_same_pixels(self, found, self.found(meant))
        told = "\n".join(told.output)
        self.assertIn("1 NaN voxels became 0", told)
        self.assertIn("1 negative voxels became 0", told)
        self.assertIn("1 negative infinite voxels became 0", told)
        self.assertIn("1 infinite voxels became the largest finite value", told)
        with self.assertLogs("brume", logging.WARNING) as told:
            self.found(-d - 1)
        self.assertIn("mostly negative", "\n".join(told.output))

    def test_arrays_are_copied_when_the_scene_is_made(self):
        d = self.density.copy()
        made = brume.Scene(scene({"density": d, "sigma_t": 0.7}))
        d[:] = 0
        assert_same_pixels(self, made.render(spp=2), self.expected)
        made["volumes"][0]["density"][:] = 0  # a copy, too
        assert_same_pixels(self, made.render(spp=2), self.expected)
        assert_same_pixels(self, made.render(spp=2, volumes__0__density=self.density * 3), self.found(self.density * 3))
        assert_same_pixels(self, made.render(spp=2), self.expected)

    def test_a_curve_and_a_limit_apply_to_arrays(self):
        curve = [[0.0, 0.0], [4.0, 8.0], [8.0, 8.0]]
        meant = np.minimum(np.minimum(2 * self.density, 8), 7)
        assert_same_pixels(self, self.found(self.density, remap=curve, max_density=7.0), self.found(meant))

    def test_fire_needs_no_smoke(self):
        fire = scene({"temperature": self.density, "temperature_scale": 300.0, "blackbody_intensity": 10.0},
                     environment={"radiance": 0.0}, lights=[])
        self.assertGreater(brume.render(fire, spp=2).image().max(), 0.01)
        flame = scene({"flame": self.density / 8}, environment={"radiance": 0.0}, lights=[])
        self.assertGreater(brume.render(flame, spp=2).image().max(), 0.01)


@unittest.skipUnless(pyopenvdb, "needs Debian's python3-openvdb")
class Files(Folder):
    def setUp(self):
        super().setUp()
        rng = np.random.default_rng(2)
        shape = (37, 24, 30)
        density = rng.random(shape, dtype=np.float32) ** 2
        density[:3] = 0
        density[20:, 10:, :9] = 0
        self.arrays = {
            "density": density,
            "temperature": np.where(density > 0, 3 * rng.random(shape), 0).astype(np.float32),
            "flame": np.where(density > 0.5, rng.random(shape), 0).astype(np.float32),
            "color": rng.random((*shape, 3), dtype=np.float32),
            "velocity": (0.4 * rng.standard_normal((*shape, 3))).astype(np.float32),
        }
        grids = []
        for name, array in self.arrays.items():
            grid = pyopenvdb.FloatGrid() if array.ndim == 3 else pyopenvdb.Vec3SGrid()
            grid.copyFromArray(array)
            grid.name, grid.transform = name, pyopenvdb.createLinearTransform(0.1)
            if array.ndim == 3:
                grid.gridClass = pyopenvdb.GridClass.FOG_VOLUME
            grids.append(grid)
        self.file = self.folder / "all.vdb"
        pyopenvdb.write(str(self.file), grids)

    def test_arrays_have_the_bits_of_the_same_volume_in_a_file(self):
        keys = {"temperature": {"temperature_grid": "auto"}, "flame": {"flame_grid": "auto"},
                "color": {"albedo_grid": "auto"}, "velocity": {"velocity_grid": "auto"}}
        common = {"name": "thing", "sigma_t": 3.0, "albedo": 0.9, "temperature_scale": 700.0, "blackbody_intensity": 4000.0}
        pictures = []
        for names, more, render in (
            ([], {}, {}),
            ([], {}, {"clean": True}),
            ([], {"index_offset": [0.5, 0.5, 0.5], "object_to_world": np.diag([1.0, -2.0, 1.0, 1.0])}, {}),
            ([], {"remap": [[0.0, 0.0], [0.5, 1.0], [1.0, 1.2]], "max_density": 0.9}, {}),
            ([], {}, {"render__cell_size": 16}),
            (["temperature"], {}, {}),
            (["flame"], {"flame_intensity": 0.3}, {}),
            (["color"], {}, {}),
            (["velocity"], {"velocity_scale": 1.5}, {"layers": "all"}),
            (["temperature", "velocity", "color"], {}, {"clean": True}),
        ):
            file = {"file": self.file, **common, **more}
            arrays = {"density": self.arrays["density"], "voxel_size": 0.1, **common, **more}
            for name in names:
                file.update(keys[name])
                arrays[name] = self.arrays[name]
            expected = brume.Scene(scene(file)).render(spp=4, **render)
            assert_same_pixels(self, brume.Scene(scene(arrays)).render(spp=4, **render), expected, f"{names} {more}")
            pictures.append(expected.image())
        for i, picture in enumerate(pictures[2:], start=2):  # each says something of its own
            if i != 4:
                self.assertFalse(np.array_equal(picture, pictures[0]), i)

    def test_a_file_and_arrays_do_not_mix(self):
        with self.assertRaisesRegex(brume.InputError, "'file' stands beside arrays"):
            brume.Scene(scene({"file": self.file, "density": self.arrays["density"]}))


class Meshes(Folder):
    vertices = np.array([[-3.0, -3, 0], [5, -3, 0], [5, 5, 0], [-3, 5, 0.5], [1, 1, 2]])
    faces = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])

    def rendered(self, surface, **render):
        return brume.render(scene(surfaces=[{"name": "thing", **surface}]), spp=2, layers="all", **render)

    def test_arrays_have_the_bits_of_a_file(self):
        path = self.folder / "tent.ply"
        path.write_text(
            "ply\nformat ascii 1.0\nelement vertex 5\nproperty double x\nproperty double y\nproperty double z\n"
            "property float nx\nproperty float ny\nproperty float nz\nelement face 4\n"
            "property list uchar int vertex_indices\nend_header\n"
            + "".join("%r %r %r 0 0 1\n" % tuple(map(float, v)) for v in self.vertices)
            + "".join("3 %d %d %d\n" % tuple(f) for f in self.faces))
        normals = np.tile([0.0, 0, 1], (5, 1))
        for more in ({"albedo": [0.3, 0.6, 0.9]}, {"material": "conductor", "roughness": 0.2}, {"normals": "flat"},
                     {"object_to_world": np.diag([1.0, 2.0, -1.0, 1.0])}, {"radiance": 2.0}):
            expected = self.rendered({"file": path, **more})
            given = {"vertices": self.vertices, "faces": self.faces, **more}
            if "normals" not in more:
                given["normals"] = normals
            assert_same_pixels(self, self.rendered(given), expected, str(more))

    def test_lists_and_polygons_are_taken(self):
        quad = {"vertices": self.vertices[:4].tolist(), "faces": [[0, 1, 2, 3]]}
        triangles = {"vertices": self.vertices[:4], "faces": np.array([[0, 1, 2], [0, 2, 3]], np.uint8)}
        assert_same_pixels(self, self.rendered(quad), self.rendered(triangles))

    def test_concave_polygons_cover_their_area(self):
        notched = {"vertices": [[0, 0, 0], [4, 0, 0], [1, 1, 0], [0, 4, 0]], "faces": [[1, 2, 3, 0]]}
        triangles = {"vertices": notched["vertices"], "faces": [[0, 1, 2], [0, 2, 3]]}
        shares = [self.rendered(surface)["surface_share.A"] for surface in (notched, triangles)]
        self.assertGreater(shares[0].max(), 0.9)
        np.testing.assert_allclose(*shares, atol=1e-5)

    def test_what_is_wrong_with_a_mesh_is_said(self):
        v, f = self.vertices, self.faces
        for surface, words in (
            ({"vertices": v}, "surfaces.0: has no faces; a mesh of arrays has vertices and faces"),
            ({"faces": f}, "surfaces.0: has no vertices"),
            ({"vertices": v[:, :2], "faces": f}, "surfaces.0.vertices: expected vertices x 3, found 5 x 2"),
            ({"vertices": v, "faces": f[:, :2]}, "surfaces.0.faces: expected faces x corners, at least 3"),
            ({"vertices": v, "faces": f, "normals": v[:2]}, "surfaces.0.normals: 2 rows, expected 5"),
            ({"vertices": v, "faces": f + 1}, "surfaces.0: face 0 names a vertex that is not there; there are 5"),
            ({"vertices": v, "faces": -f}, "names a vertex that is not there"),
            ({"vertices": 0 * v, "faces": f}, "holds no triangle with an area"),
            ({"vertices": v, "faces": f, "file": "a.obj"}, "'file' stands beside arrays"),
            ({}, r"\[\[surfaces\]\] has no 'file'"),
        ):
            with self.assertRaisesRegex(brume.InputError, words):
                self.rendered(surface)
        with self.assertRaisesRegex(TypeError, "surfaces.0.faces: expected integers, found float64"):
            self.rendered({"vertices": v, "faces": f.astype(float)})

    def test_a_mesh_moves_with_its_vertices(self):
        made = brume.Scene(scene(surfaces=[{"vertices": self.vertices, "faces": self.faces}]))
        lifted = self.vertices + [0, 0, 0.7]
        assert_same_pixels(self, made.render(spp=2, surfaces__0__vertices=lifted),
                           brume.render(scene(surfaces=[{"vertices": lifted, "faces": self.faces}]), spp=2))
        again = brume.Scene(dict(made))
        np.testing.assert_array_equal(again["surfaces"][0]["vertices"], self.vertices)


if __name__ == "__main__":
    unittest.main()
