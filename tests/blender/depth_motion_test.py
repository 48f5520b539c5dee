"""The passes Mist and Vector against Cycles', and what they are of smoke. Runs inside Blender."""

import os
import sys

import bpy
import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import addon_scene as scenes  # noqa: E402
from brume_blender import engine  # noqa: E402
from builder import Shader, aim, diffuse, scattering  # noqa: E402
from built import BuiltTest  # noqa: E402

WIDTH, HEIGHT = 64, 48


def keyed(thing, path, values, index=-1):
    """Straight from frame to frame. @param values  by frame"""
    for frame, value in values.items():
        if index >= 0:
            getattr(thing, path)[index] = value
        else:
            setattr(thing, path, value)
        thing.keyframe_insert(path, index=index, frame=frame)
    for curve in thing.animation_data.action.fcurves:
        for key in curve.keyframe_points:
            key.interpolation = "LINEAR"


class DepthMotion(BuiltTest):
    def setUp(self):
        self.build(WIDTH, HEIGHT, [0.3, 0.4, 0.6])
        self.b.scene.frame_set(10)

    def things(self):
        """A ball, a floor and a box, of which two copies stand about."""
        b = self.b
        b.floor(diffuse("Floor", (0.5, 0.5, 0.5)), 8)
        box = b.mesh("cube", "Box", diffuse("Box", (0.6, 0.3, 0.2)), size=1)
        instance = b.collection("Boxes", [box])
        ball = b.mesh("ico_sphere", "Ball", diffuse("Ball", (0.2, 0.4, 0.7)), subdivisions=5, radius=0.9, location=(1, 0, 0.9))
        return ball, instance((-1.6, 0, 0.6)), instance((-0.2, 2, 0.5))

    def compare(self, name, components, within, edge=0.4):
        """Inside of what is seen, away from edges, where depths differ by more than that. @return brume's and Cycles'"""
        self.layer.use_pass_z = True
        theirs, ours = self.rendered("CYCLES"), self.rendered("BRUME")
        depth = theirs("Depth", "Z")[..., 0]
        inner = depth < 1e9
        for dy in (-1, 0, 1):
            for dx in (-1, 0, 1):
                inner &= np.abs(np.roll(depth, (dy, dx), (0, 1)) - depth) < edge
        inner[[0, -1]] = inner[:, [0, -1]] = False
        self.assertGreater(inner.mean(), 0.25)
        a, b = ours(name, components), theirs(name, components)
        off = np.abs(a - b)[inner]
        print(f"{self.id()}: off by {off.mean():.4f}, at most {off.max():.4f}, of {np.abs(b[inner]).mean():.3f}")
        self.assertLess(off.mean(), within)
        self.assertLess(np.quantile(off, 0.99), 8 * within)
        return a, b

    # Mist

    def test_mist_grows_as_cycles_has_it(self):
        self.things()
        self.layer.use_pass_mist = True
        mist = self.b.scene.world.mist_settings
        mist.start, mist.depth = 6, 6
        for falloff in ("LINEAR", "QUADRATIC", "INVERSE_QUADRATIC"):
            with self.subTest(falloff):
                mist.falloff = falloff
                ours, _ = self.compare("Mist", "Z", 0.003)
                self.assertGreater(np.ptp(ours[-10:]), 0.1, "the floor")
                np.testing.assert_array_equal(ours[0], 1)
        self.b.scene.camera.data.type, self.b.scene.camera.data.ortho_scale = "ORTHO", 6
        self.compare("Mist", "Z", 0.003, edge=0.9)

    def test_mist_follows_animated_settings_and_a_scene_without_a_world(self):
        self.things()
        self.layer.use_pass_mist = True
        world = self.b.scene.world
        for frame, start in ((1, 0.0), (10, 4.0)):
            world.mist_settings.start = start
            world.mist_settings.keyframe_insert("start", frame=frame)
        self.b.scene.frame_set(10)
        self.compare("Mist", "Z", 0.003)
        self.b.scene.world = None
        self.compare("Mist", "Z", 0.003)

    def test_cleaning_films_and_holdouts_leave_both_as_cycles_has_them(self):
        """A holdout that moves is neither misty nor a thing that moves."""
        ball, *_ = self.things()
        keyed(ball, "location", {9: (0.7, 0, 0.9), 10: (1, 0, 0.9), 11: (1.2, -0.5, 1.1)})
        ball.is_holdout = True
        self.layer.use_pass_mist = self.layer.use_pass_vector = True
        mist = self.b.scene.world.mist_settings
        mist.start, mist.depth, mist.falloff = 6, 6, "LINEAR"
        self.b.scene.frame_set(10)
        theirs = self.rendered("CYCLES")
        for transparent, clean in ((False, True), (True, False), (True, True)):
            self.b.scene.render.film_transparent = transparent
            ours = self.rendered("BRUME", clean=clean)
            self.assertLess(np.abs(ours("Mist", "Z") - theirs("Mist", "Z")).mean(), 0.01)
            self.assertEqual(ours("Mist", "Z")[22, 39], 1, "the ball")
            moves = np.abs(ours("Vector", "XYZW")).max(-1) > 1e-5
            self.assertFalse(moves[:28].any())
            self.assertLess(moves.sum(), 10, "where it touches the floor, which is in those pixels")
            if not transparent:
                self.assertIn("Ball: leaves a hole in the picture, but none in its alpha unless Film > Transparent is on", engine.Said.texts)

    def test_smoke_is_misty_by_what_it_covers(self):
        """Of a thin slab of half opacity: half of what the slab has, half of what is behind it."""
        b = self.b
        aim(b.scene.camera, (0, 0, 2))
        slab = b.mesh("cube", "Slab", size=1, location=(0, 0, 2))
        slab.scale = (8, 0.01, 8)
        b.mesh("plane", "Wall", diffuse("Wall", (0.5, 0.5, 0.5)), size=30, location=(0, 3, 2), rotation=(1.5707963, 0, 0))
        slab.data.materials.append(absorbing("Fog", np.log(2) / 0.01))
        self.layer.use_pass_mist = True
        mist = b.scene.world.mist_settings
        mist.start, mist.depth, mist.falloff = 5, 10, "LINEAR"
        for transparent in (False, True):
            b.scene.render.film_transparent = transparent
            found = self.rendered("BRUME")("Mist", "Z")[HEIGHT // 2, WIDTH // 2, 0]
            self.assertAlmostEqual(found, (0.4 + 0.7) / 2, delta=0.004)

    # Vector

    def test_vectors_of_things_that_move_are_cycles_ones(self):
        ball, still, moving = self.things()
        keyed(ball, "location", {9: (0.7, 0, 0.9), 10: (1, 0, 0.9), 11: (1.2, -0.5, 1.1)})
        keyed(moving, "rotation_euler", {9: (0, 0, -0.2), 10: (0, 0, 0), 11: (0, 0, 0.3)})
        self.b.scene.frame_set(10)
        self.layer.use_pass_vector = True
        ours, theirs = self.compare("Vector", "XYZW", 0.02)
        self.assertGreater(np.abs(theirs).max(), 2)
        np.testing.assert_allclose(ours[-1], 0, atol=1e-5)

    def test_vectors_of_a_camera_that_moves_are_cycles_ones(self):
        self.things()
        camera = self.b.scene.camera
        keyed(camera, "location", {9: (-0.3, -9, 2), 10: (0, -9, 2), 11: (0.2, -8.6, 2.3)})
        self.b.scene.frame_set(10)
        self.layer.use_pass_vector = True
        self.compare("Vector", "XYZW", 0.03)
        self.b.scene.render.pixel_aspect_x, camera.data.shift_x = 1.4, 0.1
        self.compare("Vector", "XYZW", 0.03)

    def test_vectors_know_zooms(self):
        """Which Cycles' do not."""
        self.things()
        keyed(self.b.scene.camera.data, "lens", {9: 45, 10: 50, 11: 60})
        self.b.scene.frame_set(10)
        self.layer.use_pass_vector = True
        found = self.rendered("BRUME")("Vector", "XYZW")
        y, x = np.mgrid[0.5:HEIGHT, 0.5:WIDTH]
        x, y = x - WIDTH / 2, HEIGHT / 2 - y
        expected = np.stack([-0.1 * x, -0.1 * y, -0.2 * x, -0.2 * y], -1)
        np.testing.assert_allclose(found, expected, atol=2e-3)

    def test_a_camera_that_a_marker_changes_does_not_fly_there(self):
        """Neither in the pass nor in motion blur."""
        self.things()
        other = self.b.link(bpy.data.cameras.new("Other"), "Other", (6, -3, 2))
        aim(other, (0, 0, 0.5))
        for frame, camera in ((1, self.b.scene.camera), (10, other)):
            self.b.scene.timeline_markers.new("", frame=frame).camera = camera
        self.b.scene.frame_set(10)
        self.layer.use_pass_vector = True
        found = self.rendered("BRUME")("Vector", "XYZW")
        np.testing.assert_allclose(found, 0, atol=1e-5)
        sharp = self.rendered("BRUME")("Combined", "RGB")
        self.b.scene.render.use_motion_blur = True
        blurred = self.rendered("BRUME")("Combined", "RGB")
        self.assertLess(np.abs(blurred - sharp).mean(), 0.01)

    def test_smoke_moves_with_its_object_and_the_picture_stays(self):
        b = self.b
        smoke = b.volume("fire.vdb", "Smoke", scattering("S", "density", 15, 0.9), (-1, -1, 0))
        smoke.data.velocity_scale = 0
        twin = b.link(smoke.data, "Twin", (1, 1, 0))
        keyed(smoke, "location", {9: (-1.2, -1, 0), 10: (-1, -1, 0), 11: (-1, -1, 0.3)})
        b.scene.frame_set(10)
        before = self.rendered("BRUME")("Combined", "RGB")
        self.layer.use_pass_vector = True
        layers = self.rendered("BRUME")
        # Places of one volume and volumes of their own are not rendered with the same random numbers.
        self.assertLess(abs(layers("Combined", "RGB").mean() / before.mean() - 1), 0.01)
        found = layers("Vector", "XYZW")
        where = np.unravel_index(np.argmin(found[..., 3]), found.shape[:2])
        per_unit = 0.5 * WIDTH / np.tan(np.radians(20))
        for value, moved in zip(found[where], (-0.2, 0, 0, -0.3)):
            self.assertAlmostEqual(value, moved * per_unit / 9, delta=0.12 * abs(moved) * per_unit / 9 + 0.05)
        self.assertGreater((np.abs(found).max(-1) < 1e-4).mean(), 0.3, "the sky and its twin stand still")
        smoke.animation_data_clear()
        smoke.data.velocity_scale, twin.hide_render = 0.01, True
        by_frame = self.rendered("BRUME")
        self.layer.use_pass_vector = False
        np.testing.assert_array_equal(by_frame("Combined", "RGB"), self.rendered("BRUME")("Combined", "RGB"))
        self.layer.use_pass_vector, smoke.data.velocity_unit = True, "SECOND"
        by_second = self.rendered("BRUME")("Vector", "XYZW")
        self.assertGreater(np.quantile(by_frame("Vector", "XYZW")[..., 3], 0.05), -30)
        self.assertLess(np.quantile(by_frame("Vector", "XYZW")[..., 3], 0.05), -0.1, "it rises")
        ratio = np.abs(by_frame("Vector", "XYZW")).sum() / np.abs(by_second).sum()
        self.assertAlmostEqual(ratio, b.scene.render.fps, delta=0.05 * b.scene.render.fps)

    def test_frames_below_one_have_vectors_and_their_own_noise(self):
        ball, *_ = self.things()
        keyed(ball, "location", {-6: (0.7, 0, 0.9), -5: (1, 0, 0.9), -4: (1.3, 0, 0.9)})
        self.b.scene.frame_set(-5)
        before = self.rendered("BRUME")("Combined", "RGB")
        self.layer.use_pass_vector = True
        layers = self.rendered("BRUME")
        np.testing.assert_array_equal(layers("Combined", "RGB"), before)
        self.assertGreater(np.abs(layers("Vector", "XYZW")[..., 0]).max(), 1)

    def test_what_deforms_is_said(self):
        ball, *_ = self.things()
        ball.shape_key_add(name="Basis")
        key = ball.shape_key_add(name="Wide")
        key.data[0].co.x -= 1
        for frame in (9, 11):
            key.value = frame / 11
            key.keyframe_insert("value", frame=frame)
        self.layer.use_pass_vector = True
        engine.forget_what_was_said()
        self.rendered("BRUME")
        self.assertIn("Ball: its deformation is left out of the pass Vector", engine.Said.texts)


def absorbing(name, sigma):
    """A fog of black: what it covers is its opacity."""
    s = Shader(name)
    return s.volume(s.node("VolumeAbsorption", Color=(0, 0, 0), Density=sigma))


if __name__ == "__main__":
    scenes.run_tests(sys.modules[__name__])
