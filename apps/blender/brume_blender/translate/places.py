"""Where a volume lies: what coordinates, Object Info and Light Path give at its points."""

import numpy as np

from .node_values import UnknownNode


class Place:
    """@param thing  evaluated object   @param world  its matrix   @param box  (lowest, highest) corner of its texture space, or
    None: its own space is that   @param random_id  of its instance   @param depsgraph  that evaluates others
    @param trees  of shaders that have been read (frozen.frozen)
    @param alone  what tells an instance from others that are alike, where it moves by itself; None: nothing has to
    @param instancer  object that it is an instance of; None: it is none"""

    def __init__(self, thing, world, depsgraph=None, box=None, random_id=0, alone=None, trees=None, instancer=None):
        self._world, self.depsgraph, self._box = np.array(world), depsgraph, box
        self._colour, self._index = (tuple(thing.color), float(thing.pass_index)) if thing is not None else ((1, 1, 1, 1), 0.0)
        self._properties = {**_properties_of(getattr(thing, "data", None)), **_properties_of(thing)}
        self._instancers = self._properties if instancer is None else {**self._properties, **_properties_of(instancer)}
        self.trees = {} if trees is None else trees
        self._random = (random_id & 0xFFFFFFFF) / 0xFFFFFFFF  # Python has it signed
        self.alone = alone
        self.paths = False  # whether Light Path was asked for
        self.told = False  # whether anything was asked for that differs between objects, or instances, that are alike

    def box_key(self):
        """Equal for places of the same texture space."""
        return None if self._box is None else tuple(np.ravel(self._box))

    def key(self):
        """Equal for places at which everything is the same."""
        return self._world.tobytes(), self._colour, self._index, self._random, repr(self._properties), repr(self._instancers)

    def leaf(self, plug, points):
        """What an output is at points of the object's space, (N, 3); None: it is none of a place's. @throws UnknownNode"""
        node, name = plug.node, plug.socket.name
        if node.type == "TEX_COORD":
            return self._coordinates(node, name, points)
        if node.type == "NEW_GEOMETRY" and name == "Position":
            self.told = True
            return _moved(self._world, points)
        if node.type == "OBJECT_INFO":
            self.told = True
            return self._info(name)
        if node.type == "ATTRIBUTE" and node.attribute_type in ("OBJECT", "INSTANCER"):
            self.told = True
            values = self._properties if node.attribute_type == "OBJECT" else self._instancers
            return _attribute(values.get(node.attribute_name.removeprefix('["').removesuffix('"]'), (0.0,) * 4), plug)
        if node.type == "LIGHT_PATH":
            self.paths = True
            return 0.0
        return None

    def generated(self, points):
        if self._box is None:
            return points
        lo, hi = self._box
        return 0.5 + (points - 0.5 * (lo + hi)) / np.where(hi > lo, hi - lo, 2)  # flat ones are two wide

    def _coordinates(self, node, name, points):
        if name == "Generated":
            return self.generated(points)
        if name == "UV":
            return np.zeros(3)  # a volume has none
        if name != "Object":
            raise UnknownNode(f"Texture Coordinate ({name})")
        if node.object is None:
            return points
        self.told = True
        other = node.object.evaluated_get(self.depsgraph) if self.depsgraph is not None else node.object
        return _moved(np.linalg.inv(np.array(other.matrix_world)) @ self._world, points)

    def _info(self, name):
        values = {
            "Location": self._world[:3, 3],
            "Color": np.array(self._colour[:3]),
            "Alpha": self._colour[3],
            "Object Index": self._index,
            "Random": self._random,
        }
        if name not in values:
            raise UnknownNode(f"Object Info ({name})")
        return values[name]


def _moved(matrix, points):
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def _properties_of(block):
    """Of an object or its data, by name: numbers, vectors and colours as four numbers. Its own, and Blender's that artists use."""
    if block is None:
        return {}
    values = {name: getattr(block, name) for name in ("color", "location", "scale", "rotation_euler", "pass_index") if hasattr(block, name)}
    values.update(block.items())
    return {name: own for name, value in values.items() if (own := _four_numbers(value)) is not None}


def _four_numbers(value):
    """None: it is nothing that shaders read."""
    try:
        own = [float(v) for v in value] if hasattr(value, "__len__") else [float(value)] * 3
    except (TypeError, ValueError):
        return None
    return (*own, *(0.0, 0.0, 1.0)[len(own) - 4 :])[:4] if 1 < len(own) <= 4 else None


def _attribute(value, plug):
    """An Attribute node's output."""
    if plug.socket.name == "Alpha":
        return value[3]
    return float(np.mean(value[:3])) if plug.socket.type == "VALUE" else np.array(value[:3])
