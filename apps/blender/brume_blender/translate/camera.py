"""Blender's camera: position, projection, lens. Panoramas have no counterpart."""

import math
from dataclasses import dataclass

from mathutils import Vector

from .notes import CannotTranslate
from .toml_text import Table


@dataclass
class Pose:
    """Where a camera is and what it looks at, at one time."""

    position: Vector
    look_at: Vector
    up: Vector


def camera_of(depsgraph, scene):
    """The evaluated camera. @throws CannotTranslate: there is none, or one of which brume has no counterpart"""
    if scene.camera is None:
        raise CannotTranslate("the scene has no camera")
    camera = scene.camera.evaluated_get(depsgraph)
    if camera.type != "CAMERA":
        raise CannotTranslate(f"{camera.name}: is a {camera.type.lower()}; brume looks through cameras alone")
    if camera.data.type not in ("PERSP", "ORTHO"):
        raise CannotTranslate(
            f"{camera.name}: brume has no {camera.data.type.lower()} camera; it has perspective and orthographic ones"
        )
    return camera


def focus_of(camera, depsgraph):
    """Distance to the plane in focus, along the view."""
    dof = camera.data.dof
    if dof.focus_object is None:
        return dof.focus_distance
    target = dof.focus_object.evaluated_get(depsgraph)
    matrix = target.matrix_world
    if dof.focus_subtarget and target.pose and dof.focus_subtarget in target.pose.bones:
        matrix = matrix @ target.pose.bones[dof.focus_subtarget].matrix
    pose = pose_of(camera)
    return abs((matrix.translation - pose.position).dot(pose.look_at - pose.position))


def pose_of(camera, distance=1.0):
    """Without the scale of the camera's object. @param distance  of what it looks at"""
    axes = camera.matrix_world.to_3x3().normalized()
    position = camera.matrix_world.translation.copy()
    return Pose(position, position - distance * axes.col[2], axes.col[1])


@dataclass
class Sensor:
    """What a camera's sensor spans of the picture."""

    horizontal: bool  # the fit: the field of view is given along the width
    size: float  # [mm]
    shift: tuple  # [picture widths, picture heights]

    def __init__(self, data, width, height, pixel_aspect):
        across, upright = width * pixel_aspect, height
        self.horizontal = data.sensor_fit == "HORIZONTAL" or (data.sensor_fit == "AUTO" and across > upright)
        self.size = data.sensor_height if data.sensor_fit == "VERTICAL" else data.sensor_width
        fitted = across if self.horizontal else upright
        self.shift = (data.shift_x * fitted / across, data.shift_y * fitted / upright)


def projection_of(camera, sensor):
    """fov [degrees] or width [scene units] along the fitted side, as a scene's key and value."""
    data = camera.data
    if data.type == "ORTHO":
        return {"width": data.ortho_scale}
    return {"fov": math.degrees(2 * math.atan(0.5 * sensor.size / data.lens))}


def lens_keys(data, focus):
    """Of a thin lens. @param data  of the camera"""
    aperture = 1.0 if data.type == "ORTHO" else 1e-3 * data.lens
    keys = {"lens_radius": 0.5 * aperture / max(data.dof.aperture_fstop, 1e-5), "focus_distance": focus}
    blades = data.dof.aperture_blades
    if blades >= 3:
        # Cycles turns a side to the right, brume a corner.
        keys.update(blades=blades, blade_rotation=math.degrees(data.dof.aperture_rotation) - 180 / blades)
    return keys


def say_clipped(camera, name, corners, matrix, notes):
    """Brume's cameras see from their eye to the end of the world.
    @param corners  of a box around an object, in its own space   @param matrix  of the object, in the world"""
    placed = camera.matrix_world.normalized().inverted() @ matrix
    depths = [-(placed @ Vector(corner)).z for corner in corners]
    if not depths:
        return
    near, far = camera.data.clip_start, camera.data.clip_end
    if max(depths) > far:
        notes.say(name, f"is seen beyond {far:.4g}, where Blender's camera clips")
    elif 0 < min(depths) < near:
        notes.say(name, f"is seen nearer than {near:.4g}, where Blender's camera clips")


def camera_table(depsgraph, camera, motion, width, height, pixel_aspect, notes):
    """The table [camera]. @param motion  poses as the shutter opens and closes (motion.Motion), or None"""
    data = camera.data
    sensor = Sensor(data, width, height, pixel_aspect)
    focus = focus_of(camera, depsgraph) if data.dof.use_dof else 0
    pose = pose_of(camera, focus or 1.0)
    moves = motion is not None and motion.moves_camera(camera)
    if moves:
        pose = motion.opens.camera
    table = Table("[camera]")
    if data.type == "ORTHO":
        table.set(type="orthographic")
    table.set(position=pose.position, look_at=pose.look_at, up=pose.up, fov_axis="x" if sensor.horizontal else "y")
    table.set(**projection_of(camera, sensor))
    if any(sensor.shift):
        table.set(shift=sensor.shift)
    if pixel_aspect != 1:
        table.set(pixel_aspect=pixel_aspect)
    if data.dof.use_dof:
        table.set(**lens_keys(data, focus))
        if data.dof.aperture_ratio != 1:
            notes.say(camera.name, "its aperture is stretched in Blender; it is round here")
    if motion is not None:
        table.set(shutter=motion.shutter)
    if moves:
        end = motion.closes.camera
        table.set(position_end=end.position, look_at_end=end.look_at, up_end=end.up)
    if motion is not None and motion.opens.projection != motion.closes.projection:
        notes.say(camera.name, "its zoom is left out of the motion blur")
    return table
