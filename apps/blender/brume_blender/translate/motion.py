"""Where things are as the shutter opens and closes."""

import math
from dataclasses import dataclass, field

import numpy as np

from .camera import Sensor, focus_of, pose_of, projection_of

# Modifiers by which a mesh's shape follows something that may move.
DEFORMING = {
    "ARMATURE", "CAST", "CLOTH", "CURVE", "DISPLACE", "HOOK", "LATTICE", "MESH_CACHE", "MESH_DEFORM", "MESH_SEQUENCE_CACHE", "NODES",
    "OCEAN", "SHRINKWRAP", "SIMPLE_DEFORM", "SOFT_BODY", "SURFACE_DEFORM", "WARP", "WAVE",
}  # fmt: skip


def shutter_of(scene, layer):
    """[open, close] around the frame [frames]; None: no motion blur. @param layer  the view layer"""
    render = scene.render
    if not render.use_motion_blur or not getattr(layer, "use_motion_blur", True) or not render.motion_blur_shutter > 0:
        return None
    # A setting of Cycles until it became one of the scene.
    position = getattr(render, "motion_blur_position", None) or getattr(
        getattr(scene, "cycles", None), "motion_blur_position", "CENTER"
    )
    opens = {"START": 0.0, "CENTER": -0.5, "END": -1.0}[position] * render.motion_blur_shutter
    return opens, opens + render.motion_blur_shutter


def key_of(instance):
    """The same for an instance at other times."""
    parent = instance.parent.name if instance.parent else ""
    return (parent, instance.object.name, tuple(instance.persistent_id) if instance.is_instance else ())


@dataclass
class Moment:
    """The scene at one time."""

    camera: object = None  # its Pose
    projection: dict = field(default_factory=dict)
    focus: float = 0.0
    matrices: dict = field(default_factory=dict)  # by key_of
    shapes: dict = field(default_factory=dict)  # by an object's name: a digest of what deforms


def moment(depsgraph, camera, width, height, pixel_aspect):
    """@param camera  the original of this frame, even where a marker changes it at the time at which the depsgraph is"""
    m = Moment()
    camera = camera.evaluated_get(depsgraph)
    m.focus = focus_of(camera, depsgraph) if camera.data.dof.use_dof else 0
    m.camera = pose_of(camera, m.focus or 1.0)
    m.projection = projection_of(camera, Sensor(camera.data, width, height, pixel_aspect))
    for instance in depsgraph.object_instances:
        m.matrices[key_of(instance)] = instance.matrix_world.copy()
        thing = instance.object
        if thing.name not in m.shapes and _may_deform(thing):
            m.shapes[thing.name] = _shape(thing)
    return m


def _may_deform(thing):
    if thing.type != "MESH" or not getattr(getattr(thing, "cycles", None), "use_deform_motion", True):
        return False
    return thing.data.shape_keys is not None or any(m.show_render and m.type in DEFORMING for m in thing.modifiers)


def _shape(thing):
    points = np.empty(3 * len(thing.data.vertices), np.float32)
    thing.data.vertices.foreach_get("co", points)
    return len(points), hash(points.tobytes())


@dataclass
class Motion:
    """What moves over the shutter."""

    shutter: tuple
    opens: Moment
    closes: Moment

    def matrices(self, instance):
        """World matrices of an instance as the shutter opens and closes; None: it stands still."""
        if not getattr(getattr(instance.object, "cycles", None), "use_motion_blur", True):
            return None
        key = key_of(instance)
        a, b = self.opens.matrices.get(key), self.closes.matrices.get(key)
        return (a, b) if a is not None and b is not None and a != b else None

    def moves_camera(self, camera):
        blurred = getattr(getattr(camera, "cycles", None), "use_motion_blur", True)
        return blurred and self.opens.camera != self.closes.camera

    def deforms(self, thing):
        return self.opens.shapes.get(thing.name) != self.closes.shapes.get(thing.name)


def motion_of(depsgraph, scene, camera, frame, set_frame, size, notes):
    """None: nothing is blurred. @param camera  of this frame   @param set_frame  function of (frame, subframe) that evaluates the depsgraph then; None:
    there is none   @param size  width, height, pixel aspect"""
    shutter = shutter_of(scene, depsgraph.view_layer)
    if shutter is None:
        return None
    if set_frame is None:
        notes.say("Motion blur", "is left out: the scene is known at one time alone")
        return None
    moments, original = [], camera.original
    try:
        for t in shutter:
            whole = math.floor(frame + t)
            set_frame(whole, frame + t - whole)
            moments.append(moment(depsgraph, original, *size))
    finally:
        set_frame(frame, 0.0)
    _say_settings(scene, notes)
    return Motion(shutter, *moments)


def _say_settings(scene, notes):
    render = scene.render
    rolling = getattr(getattr(scene, "cycles", None), "rolling_shutter_type", "NONE")
    if rolling != "NONE":
        notes.say("Rolling shutter", "is left out: all of the picture is exposed at once")
    curve = render.motion_blur_shutter_curve
    if curve is not None and any(abs(point.location[1] - 1) > 1e-4 for point in curve.curves[0].points):
        notes.say("Shutter curve", "is left out: the shutter opens and closes at once")
