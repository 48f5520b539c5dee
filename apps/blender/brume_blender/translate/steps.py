"""What moves from frame to frame: the scene as it is a frame earlier and later, for the pass Vector."""

import math

from .camera import camera_table
from .motion import key_of, moment
from .notes import Notes
from .placement import invertible


class Steps:
    """Where things are a frame before, and a frame after."""

    def __init__(self, moments, cameras, notes):
        """@param moments  motion.Moment of the frame before, and of the one after   @param cameras  their tables [camera]"""
        self._moments, self._cameras, self._notes = moments, cameras, notes
        self._owners = {}  # instances' keys and matrices by id() of their tables

    def moves(self, instance):
        return any(m.matrices.get(key_of(instance), instance.matrix_world) != instance.matrix_world for m in self._moments)

    def own(self, tables, instance):
        """Tells that the tables are of an instance."""
        key, thing = key_of(instance), instance.object
        for table in tables:
            self._owners[id(table)] = (key, instance.matrix_world.copy())
        if tables and len({m.shapes.get(thing.name) for m in self._moments}) > 1:
            self._notes.say(thing.name, "its deformation is left out of the pass Vector")

    def tables(self, tables):
        """A scene's tables as they are a frame before, and as they are a frame after."""
        return [[self._then(table, m, camera) for table in tables] for m, camera in zip(self._moments, self._cameras)]

    def _then(self, table, moment, camera):
        if table.header == "[camera]":
            return camera
        key, now = self._owners.get(id(table), (None, None))
        then, placed = moment.matrices.get(key), table.value("object_to_world")
        if then is None or placed is None or then == now:
            return table
        if invertible(then.copy(), table.header == "[[surfaces]]") is None or not now.determinant():
            self._notes.say(key[1], "grows from nothing or shrinks to it, and stands still in the pass Vector")
            return table
        return table.without(("object_to_world",)).set(object_to_world=then @ now.inverted() @ placed)


def steps_of(depsgraph, camera, frame, set_frame, size, notes):
    """@param camera  of this frame, whichever others have   @param set_frame  evaluates the depsgraph at another frame
    @param size  width, height, pixel aspect"""
    moments, cameras, original = [], [], camera.original
    try:
        for other in (frame - 1, frame + 1):
            set_frame(other, 0.0)
            moments.append(moment(depsgraph, original, *size))
            cameras.append(camera_table(depsgraph, original.evaluated_get(depsgraph), None, *size, Notes()))
    finally:
        set_frame(frame, 0.0)
    return Steps(moments, cameras, notes)


def mist_keys(world):
    """Of [render]. @param world  evaluated, or None"""
    if world is None:
        return {"mist_start": 0, "mist_depth": 100, "mist_falloff": "linear"}  # as Cycles does
    mist = world.mist_settings
    depth = mist.depth if mist.depth > 0 else math.inf  # as Cycles has it
    return {"mist_start": mist.start, "mist_depth": min(depth, 1e30), "mist_falloff": mist.falloff.lower()}
