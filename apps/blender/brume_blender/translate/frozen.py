"""Shader nodes as they were when they were read: all that node_values asks of them, in objects of Python. A thread may
evaluate these while Blender's own change, and Blender goes on."""

import numpy as np

from .node_values import curve_table, ramp_table
from .nodes import LOOKS, Plug, signature

SIMPLE = ("BOOLEAN", "INT", "FLOAT", "STRING", "ENUM")  # kinds of properties that are values


class Frozen:
    """Has as attributes what was read of something of Blender's."""

    def __init__(self, **attributes):
        self.__dict__.update(attributes)

    def as_pointer(self):
        return id(self)


class FrozenPlace(Frozen):
    """An object that coordinates are of. @param matrix_world  evaluated"""

    def evaluated_get(self, depsgraph):
        return self


def frozen(plug, depsgraph, trees):
    """A Plug of the same socket, and all that it gets its value from, which no longer changes.
    @param depsgraph  that evaluates objects, or None   @param trees  {}, filled: those that have been read"""
    groups = tuple(_tree(group.id_data, depsgraph, trees)[group.as_pointer()] for group in plug.groups)
    _tree(plug.node.id_data, depsgraph, trees)
    sockets = {pointer: socket for tree in trees.values() for pointer, socket in tree.sockets.items()}
    return Plug(sockets[plug.socket.as_pointer()], groups)


def images_read(trees, pictures):
    """Has the nodes of frozen trees hold Pictures of their images. @param pictures  that there are"""
    for tree in trees.values():
        for node in tree.nodes:
            if getattr(node, "image", None) is not None:
                node.image = pictures.of(node.image)


def signature_of(plug):
    """Text that is the same for frozen plugs whose trees compute the same."""
    return "\n".join(tree.signature for tree in (plug.node.id_data, *(group.id_data for group in plug.groups)))


class _Tree(dict):
    """Nodes by their pointers, and sockets."""

    def __init__(self, text):
        super().__init__()
        self.signature, self.sockets = text, {}

    @property
    def nodes(self):
        return list(self.values())


def _tree(tree, depsgraph, trees):
    key = tree.as_pointer()
    if key not in trees:
        made = trees[key] = _Tree(signature(tree))
        for node in tree.nodes:
            made[node.as_pointer()] = _node(node, made, depsgraph, trees)
        for link in tree.links:
            if link.is_valid:
                source, target = (made.sockets[s.as_pointer()] for s in (link.from_socket, link.to_socket))
                target.links.append(Frozen(from_socket=source, to_socket=target, is_valid=True))
                source.is_linked = target.is_linked = True
        objects = [node.object for node in made.nodes if getattr(node, "object", None) is not None]
        made.signature += "".join(f"\n{thing.matrix_world.tolist()}" for thing in objects)
    return trees[key]


def _node(node, tree, depsgraph, trees):
    sockets = tree.sockets
    made = Frozen(id_data=tree, **{p.identifier: _value(node, p.identifier) for p in node.bl_rna.properties if p.type in SIMPLE and p.identifier not in LOOKS})
    for side in ("inputs", "outputs"):
        setattr(made, side, [_socket(socket, made, sockets) for socket in getattr(node, side)])
    made.internal_links = [
        Frozen(from_socket=sockets[link.from_socket.as_pointer()], to_socket=sockets[link.to_socket.as_pointer()])
        for link in node.internal_links
    ]
    if hasattr(node, "node_tree"):
        made.node_tree = _tree(node.node_tree, depsgraph, trees) if node.node_tree is not None else None
    if hasattr(node, "color_ramp"):
        ramp = node.color_ramp
        made.color_ramp = Frozen(interpolation=ramp.interpolation, color_mode=ramp.color_mode, table=ramp_table(ramp))
    if hasattr(getattr(node, "mapping", None), "curves"):
        made.mapping = _curves(node.mapping)
    if hasattr(node, "image"):
        made.image = node.image  # until images_read
    if hasattr(node, "object"):
        made.object = _object(node.object, depsgraph)
    return made


def _value(thing, name):
    value = getattr(thing, name)
    return tuple(value) if hasattr(value, "__len__") and not isinstance(value, (str, set)) else value


def _socket(socket, node, sockets):
    made = Frozen(
        node=node, name=socket.name, identifier=socket.identifier, type=socket.type, enabled=socket.enabled, is_output=socket.is_output,
        is_linked=False, links=[],
    )  # fmt: skip
    if hasattr(socket, "default_value"):
        made.default_value = _value(socket, "default_value")
    sockets[socket.as_pointer()] = made
    return made


def _curves(mapping):
    mapping.initialize()
    curves = [Frozen(table=curve_table(mapping, curve)) for curve in mapping.curves]
    return Frozen(curves=curves, extend=mapping.extend, initialize=lambda: None)


def _object(thing, depsgraph):
    if thing is None:
        return None
    evaluated = thing.evaluated_get(depsgraph) if depsgraph is not None else thing
    return FrozenPlace(matrix_world=np.array(evaluated.matrix_world))
