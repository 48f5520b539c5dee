"""brume.Scene: what is kept between renders, and that it never shows in a picture."""

import copy
import gc
import logging
import os
import pathlib
import pickle
import signal
import threading
import unittest

import numpy as np

import brume
from support import (CLOUD, SMALL, SOURCE, TEXT, TINY, Folder, assert_same_pixels, cloud_array, run,
                     small_scene)

class Sources(Folder):
    def test_a_path_a_text_and_a_dict_are_one_scene(self):
        expected = brume.render(CLOUD, spp=2, **TINY)
        text = CLOUD.read_text().replace("../", f"{SOURCE}/data/")
        scene = brume.Scene(CLOUD, **TINY)
        for other in (scene, brume.Scene(text, **TINY), brume.Scene(dict(scene)), brume.Scene(scene)):
            assert_same_pixels(self, other.render(spp=2), expected)
            self.assertEqual(other.render(spp=2).header["sceneHash"], expected.header["sceneHash"])

    def test_a_bare_volume_is_framed_and_lit_as_by_render(self):
        volume = SOURCE / "data/volumes/smoke.vdb"
        scene = brume.Scene(volume, **TINY)
        assert_same_pixels(self, scene.render(spp=1), brume.render(volume, spp=1, **TINY))
        self.assertEqual(scene.counts["files_read"], 0)  # its density was read to frame it
        tall = {"film__width": 12, "film__height": 36}
        self.assertNotEqual(dict(brume.Scene(volume, **tall))["camera"]["position"], dict(scene)["camera"]["position"])
        assert_same_pixels(self, brume.Scene(volume, **tall).render(spp=1), brume.render(volume, spp=1, **tall))

    def test_a_bare_volume_of_any_name_is_found(self):
        for name in ('12" puff.vdb', "back\\slash.vdb", "'a'.vdb", '"a".vdb'):
            volume = self.folder / name
            volume.write_bytes((SOURCE / "data/volumes/smoke.vdb").read_bytes())
            brume.Scene(volume, **TINY).render(spp=1)
            scene = brume.Scene(SOURCE / "data/scenes/smoke.toml", volumes__0__file=volume, **TINY)
            self.assertEqual(dict(scene)["volumes"][0]["file"], str(volume))

    def test_a_dict_has_the_errors_of_a_scene_file(self):
        cases = (
            ({"camera": {"position": [0, -1, 0], "look_at": [0, 0, 0], "fof": 3}}, "unknown key 'fof' in .camera.; did you mean 'fov'"),
            ({"camera": {"position": [0, -1, 0], "look_at": [0, 0, 0], "fov": 400}}, "'fov' is out of range(.|\n)*in 0.001 .. 179"),
            ({"camera": {"position": [0, -1, 0]}}, r"\[camera\] has no 'look_at'"),
            ({"kamera": {}}, "unknown key 'kamera'; did you mean 'camera'"),
            ({**SMALL, "volumes": [{"sigma_t": 1}]}, r"\[\[volumes\]\] has no 'file'"),
            ({**SMALL, "volumes": [{"file": "missing.vdb"}]}, "missing.vdb: no such file"),
            ({**SMALL, "lights": [{"type": "sun"}]}, "a sun light has no 'direction'"),
            ({**SMALL, "film": {"width": 2.5}}, "'width' is a number(.|\n)*expected an integer"),
        )
        for scene, words in cases:
            with self.assertRaisesRegex(brume.InputError, words):
                brume.Scene(scene)
        with self.assertRaisesRegex(TypeError, "for a key of a scene, found object"):
            brume.Scene({"camera": {"position": object()}})
        with self.assertRaisesRegex(brume.InputError, r"volumes.1: expected a dict, found int"):
            brume.Scene({**SMALL, "volumes": [{"density": cloud_array()}, 3]})
        with self.assertRaisesRegex(brume.InputError, "nowhere.toml"):
            brume.Scene("nowhere.toml")

    def test_any_text_of_a_dict_survives(self):
        name = 'a "name"\\ with\ttabs,\nlines and grüße'
        scene = brume.Scene({**SMALL, "name": name})
        self.assertEqual(scene["name"], name)
        self.assertEqual(brume.Scene(dict(scene))["name"], name)
        self.assertEqual(scene.render(spp=1).header["scene"], name)


class Changes(unittest.TestCase):
    def test_keywords_of_render_are_for_it_alone_and_those_of_set_stay(self):
        scene = brume.Scene(TEXT)
        changed = scene.render(spp=1, environment__radiance=[0.25, 0.5, 1.0])
        np.testing.assert_allclose(changed.image()[0, 0], [0.25, 0.5, 1.0], rtol=1e-6)
        np.testing.assert_allclose(scene.render(spp=1).image()[0, 0], [0.5, 0.75, 1.0], rtol=1e-6)
        scene.set(environment__radiance=[0.25, 0.5, 1.0], camera__fov=None)
        np.testing.assert_allclose(scene.render(spp=1).image()[0, 0], [0.25, 0.5, 1.0], rtol=1e-6)
        self.assertEqual(scene["environment"]["radiance"], [0.25, 0.5, 1.0])
        self.assertEqual(scene["camera"]["fov"], 40)

    def test_a_change_that_is_wrong_changes_nothing(self):
        scene = brume.Scene(small_scene())
        before = scene.text
        with self.assertRaisesRegex(brume.InputError, "out of range"):
            scene.set(volumes__0__albedo=0.5, camera__fov=-3)
        self.assertEqual(scene.text, before)
        with self.assertRaisesRegex(brume.InputError, "up is zero or parallel"):
            scene.render(spp=1, camera__up=[0, 0, 0])
        with self.assertRaisesRegex(brume.InputError, "unknown key 'fof'"):
            scene.render(spp=1, camera__fof=3)
        assert_same_pixels(self, scene.render(spp=1), brume.render(small_scene(), spp=1))

    def test_every_render_has_the_bits_of_a_scene_made_anew(self):
        changes = (
            {},
            {"camera__position": [20.0, -20.0, 12.0]},
            {"film__width": 40, "film__height": 9, "clean": True},
            {"film__width": 300, "film__height": 300, "clean": True, "spp": 1},  # more nodes for the light
            {"lights__0__irradiance": [1.0, 2.0, 3.0], "clean": True},
            {"volumes__0__g": 0.7, "layers": "all"},
            {"volumes__0__g": 0.7, "layers": "none", "seed": 7},
            {"layers": "gradient,coverage,flash", "camera__fov": 25},
            {"layers": "direct", "statistics": False, "render__max_events": 3},
            {"render__surface_density": 0.2, "layers": "gradient"},
            {"render__lookup": "interpolated", "render__first_collision": "forced"},
            {"camera__shutter": [0.0, 0.5], "camera__position_end": [6.0, -31.0, 12.0]},
            {"volumes__0__voxel_size": [1.0, 2.0, 0.5], "volumes__0__origin": [1.0, 0.0, -1.0], "clean": True},
            {"volumes__0__density": cloud_array()[::-1], "clean": True},
            {},
        )
        scene = brume.Scene(small_scene())
        for change in changes:
            arguments = {"spp": 4, **change}
            expected = brume.render(small_scene(), **arguments)
            found = scene.render(**arguments)
            assert_same_pixels(self, found, expected, str(change.keys()))
            for key in ("sceneHash", "sceneSettings", "recordedLayers", "seed"):
                self.assertEqual(found.header[key], expected.header[key], key)

    def test_light_is_solved_again_only_where_it_must_be(self):
        scene = brume.Scene(SOURCE / "data/scenes/fire.toml", film__width=32, film__height=24)
        files = {"density", "temperature"}
        scene.render(spp=2, clean=True)
        first = scene.counts
        self.assertEqual((first["scenes_prepared"], first["lights_solved"]), (1, 1))
        self.assertGreaterEqual(first["files_read"], len(files))
        for same in ({"camera__position": [3.0, -3.0, 2.0]}, {"camera__fov": 20}, {"film__exposure": 2.0},
                     {"film__width": 50}, {"seed": 3}, {"spp": 3}, {"layers": "all"}, {"render__roulette_start": 3},
                     {"clean": "nfor"}, {"render__frame": 7}):
            scene.render(**{"spp": 2, "clean": True, **same})
            self.assertEqual(scene.counts, first, same)
        scene.render(spp=2, clean=True, volumes__0__albedo=0.35)
        second = scene.counts
        self.assertEqual((second["scenes_prepared"], second["lights_solved"]), (2, 2))
        self.assertEqual(second["files_read"], first["files_read"], "files are read once")
        scene.render(spp=2, clean=True)
        self.assertEqual(scene.counts, second, "the scene before is kept")
        scene.render(spp=1)
        self.assertEqual(scene.counts, second, "without guides no light is solved")

    def test_explain_says_what_render_would_do(self):
        scene = brume.Scene(CLOUD, **TINY)
        told = scene.explain()
        self.assertIn("delta tracking", told)
        self.assertNotIn("guides", told)
        self.assertIn("guides", scene.explain(clean=True, spp=4))
        self.assertIn("32 x 24", told)
        self.assertIn("64 x 24", scene.explain(film__width=64))
        self.assertEqual(told.split("\n")[0], run("render", CLOUD, "--explain").split("\n")[0])


class AsData(unittest.TestCase):
    def test_pickles_copies_and_dicts_render_the_same(self):
        scene = brume.Scene(small_scene(temperature=cloud_array() * 3, temperature_scale=900.0))
        scene.set(camera__fov=33.5)
        expected = scene.render(spp=2)
        copies = [pickle.loads(pickle.dumps(scene, protocol)) for protocol in range(2, pickle.HIGHEST_PROTOCOL + 1)]
        for other in copies + [scene.copy(), copy.copy(scene), copy.deepcopy(scene), brume.Scene(scene.settings)]:
            assert_same_pixels(self, other.render(spp=2), expected)
            self.assertEqual(other.text, scene.text)

    def test_a_copy_goes_its_own_way(self):
        scene = brume.Scene(TEXT)
        other = scene.copy()
        other.set(camera__fov=10)
        self.assertEqual((scene["camera"]["fov"], other["camera"]["fov"]), (40, 10))

    def test_it_is_a_mapping_of_tables(self):
        scene = brume.Scene(small_scene())
        self.assertEqual(scene.keys(), ["camera", "film", "environment", "lights", "volumes"])
        self.assertEqual((len(scene), list(scene), "film" in scene, "fire" in scene), (5, scene.keys(), True, False))
        self.assertEqual(scene["volumes"][0]["density"].shape, cloud_array().shape)
        np.testing.assert_array_equal(scene["volumes"][0]["density"], cloud_array())
        with self.assertRaisesRegex(KeyError, "no table 'volume'; did you mean 'volumes'"):
            scene["volume"]
        self.assertIn("scene.toml", repr(scene))

    def test_files_stay_found_from_another_folder(self):
        before = os.getcwd()
        os.chdir(CLOUD.parent)
        self.addCleanup(os.chdir, before)
        scene = brume.Scene("cloud.toml", **TINY)
        os.chdir("/")
        expected = brume.render(CLOUD, spp=1, **TINY)
        for other in (scene, pickle.loads(pickle.dumps(scene)), brume.Scene(dict(scene))):
            assert_same_pixels(self, other.render(spp=1), expected)
        self.assertTrue(pathlib.Path(scene["volumes"][0]["file"]).is_absolute())


def resident_bytes():
    return int(pathlib.Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


class Life(unittest.TestCase):
    def test_memory_goes_with_the_scene(self):
        # 128 MB of density, more as bricks: nothing else here is near that.
        array = np.random.default_rng(1).random((320, 320, 320), dtype=np.float32)
        scene = brume.Scene({**SMALL, "volumes": [{"density": array, "sigma_t": 0.01}]})
        scene.render(spp=1)
        held = resident_bytes()
        del scene
        gc.collect()
        self.assertGreater(held - resident_bytes(), 0.9 * array.nbytes)

    def test_several_threads_may_render_one_scene(self):
        scene, results = brume.Scene(small_scene()), {}
        expected = {seed: brume.render(small_scene(), spp=2, seed=seed, clean=True) for seed in range(4)}

        def work(seed):
            results[seed] = scene.render(spp=2, seed=seed, clean=True)

        workers = [threading.Thread(target=work, args=(seed,)) for seed in expected]
        for worker in workers:
            worker.start()
        for worker in workers:
            worker.join()
        for seed, frame in expected.items():
            assert_same_pixels(self, results[seed], frame)
        self.assertEqual(scene.counts["lights_solved"], 1)

    def test_a_scene_can_be_used_after_ctrl_c(self):
        scene = brume.Scene(CLOUD, **TINY)
        timer = threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT))
        timer.start()
        self.addCleanup(timer.cancel)
        with self.assertRaises(KeyboardInterrupt):
            scene.render(spp=1 << 20)
        assert_same_pixels(self, scene.render(spp=1), brume.render(CLOUD, spp=1, **TINY))

    def test_notes_of_a_scene_are_told_once(self):
        density = cloud_array()
        density[0, 0, 0] = np.nan
        scene = brume.Scene({**SMALL, "volumes": [{"density": density}]})
        with self.assertLogs("brume", logging.WARNING) as told:
            scene.render(spp=1)
            scene.render(spp=1, camera__fov=20)
            scene.render(spp=1, volumes__0__g=0.5)
        self.assertEqual(len([line for line in told.output if "1 NaN voxels became 0" in line]), 1)


if __name__ == "__main__":
    unittest.main()
