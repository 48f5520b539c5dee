"""Following a shader's wires: through reroutes, muted nodes and groups, from a socket to what it gets its value from."""

from .notes import LeftOut


class Plug:
    """A socket of a node, and the group nodes inside of which it lies."""

    def __init__(self, socket, groups=()):
        self.socket, self.groups = socket, groups

    @property
    def node(self):
        return self.socket.node

    def input(self, *names):
        """An input of this plug's node, by the first of its names that there is: versions of Blender rename them.
        @throws LeftOut"""
        for name in names:
            for socket in self.node.inputs:
                if name in (socket.name, socket.identifier) and socket.enabled:
                    return Plug(socket, self.groups)
        raise LeftOut(f"{self.node.bl_label} has no input '{names[0]}' in this version of Blender")

    def inputs(self):
        return [Plug(socket, self.groups) for socket in self.node.inputs if socket.enabled]

    def key(self):
        """Equal for the same socket in the same place."""
        return (self.socket.as_pointer(), tuple(group.as_pointer() for group in self.groups))

    def resolve(self):
        """Where an input gets its value: the plug of an output that computes it, or of an input that holds it."""
        here = self
        for _ in range(10000):  # wires in a circle end somewhere
            if here.socket.is_output:
                inward = here._through()
                if inward is None:
                    return here
                here = inward
            elif here.socket.is_linked and here.socket.links[0].is_valid:
                here = Plug(here.socket.links[0].from_socket, here.groups)
            else:
                return here
        return self

    def _through(self):
        """The socket that an output merely repeats; None: its node computes it."""
        node = self.node
        if node.mute:
            for link in node.internal_links:
                if link.to_socket == self.socket:
                    return Plug(link.from_socket, self.groups)
            return None
        if node.type == "REROUTE":
            return Plug(node.inputs[0], self.groups)
        if node.type == "GROUP" and node.node_tree is not None:
            for inner in node.node_tree.nodes:
                if inner.type == "GROUP_OUTPUT" and inner.is_active_output:
                    return _same(inner.inputs, self.socket, (*self.groups, node))
        if node.type == "GROUP_INPUT" and self.groups:
            return _same(self.groups[-1].inputs, self.socket, self.groups[:-1])
        return None


def _same(sockets, socket, groups):
    for other in sockets:
        if other.identifier == socket.identifier:
            return Plug(other, groups)
    return None


# Properties of a node that change nothing but its looks.
LOOKS = {
    "location", "width", "width_hidden", "height", "select", "color", "use_custom_color", "hide", "label", "show_options",
    "show_preview", "show_texture", "parent", "dimensions",
}  # fmt: skip


def signature(tree):
    """Text that is the same for trees that compute the same: nodes with all their settings, and wires."""
    if tree is None:
        return ""
    lines = []
    for node in tree.nodes:
        words = [node.bl_idname]
        for known in node.bl_rna.properties:
            if known.identifier not in LOOKS and known.type not in ("COLLECTION",):
                value = getattr(node, known.identifier, None)
                if known.type == "POINTER":
                    value = getattr(value, "name_full", None)
                words.append(f"{known.identifier}={tuple(value) if hasattr(value, '__len__') and not isinstance(value, str) else value}")
        if hasattr(node, "color_ramp"):
            ramp = node.color_ramp
            words += [ramp.interpolation, ramp.color_mode, *(f"{e.position} {tuple(e.color)}" for e in ramp.elements)]
        if hasattr(node, "mapping") and hasattr(node.mapping, "curves"):
            words += [f"{p.location[:]} {p.handle_type}" for curve in node.mapping.curves for p in curve.points]
        for socket in node.inputs:
            value = getattr(socket, "default_value", None)
            words.append(str(value[:] if hasattr(value, "__len__") else value))
        words.append(signature(getattr(node, "node_tree", None)))
        lines.append(" ".join(words))
    lines += [f"{l.from_node.name} {l.from_socket.identifier} {l.to_node.name} {l.to_socket.identifier}" for l in tree.links]
    return "\n".join(lines)


def nodes_of(tree):
    """A tree's nodes, and those of the groups in it."""
    trees, found = [tree], []
    for each in trees:  # which grows
        found += each.nodes
        for node in each.nodes:
            inner = getattr(node, "node_tree", None)
            if inner is not None and inner not in trees:
                trees.append(inner)
    return found


def as_the_camera_sees(plug, say):
    """What nodes tell that tell rays and sides of a surface apart: of camera rays, and of the front; None: it is no such node.
    @param say  function of a text: what became of a material"""
    if plug.node.type == "LIGHT_PATH":
        say("is the same for rays of every kind: as camera rays see it")
        return 1.0 if plug.socket.name == "Is Camera Ray" else 0.0
    if plug.node.type == "NEW_GEOMETRY" and plug.socket.name == "Backfacing":
        say("is the same on both sides: as its front")
        return 0.0
    return None


def tree_of(block):
    """The node tree that shades a material, world or light; None: none does. Since Blender 5 all of them use nodes."""
    return block.node_tree if block.use_nodes else None


def output_of(tree, socket):
    """What is plugged into the active output node of a material, world or light; None: nothing is.
    @param socket  'Surface', 'Volume' or 'Displacement'"""
    if tree is None:
        return None
    node = tree.get_output_node("CYCLES") or tree.get_output_node("ALL")
    if node is None or socket not in node.inputs:
        return None
    shader = Plug(node.inputs[socket]).resolve()
    return shader if shader.socket.is_output else None
