"""Light from infinitely far away: a colour, a lat-long picture, or a sky."""

import math

import numpy as np

from .beside import Pending
from .frozen import frozen, images_read
from .node_values import UnknownNode, Values
from .nodes import nodes_of, output_of, signature, tree_of
from .notes import Notes
from .painting import Painting, mean_of
from .pictures import file_of, is_linear, moves
from .sky import sky_tables
from .textures import Texture
from .toml_text import Table

BAKED = (1024, 512)  # of a world that is computed
LARGEST = (8192, 4096)
PROBES = 512  # directions at which it is looked at first


def world_of(depsgraph, scene, layer):
    """Evaluated; None: the layer has none."""
    world = getattr(layer, "world_override", None) or scene.world  # Blender 4.3
    return world.evaluated_get(depsgraph) if world is not None and layer.use_sky else None


def world_tables(depsgraph, scene, layer, folder, painter, notes):
    """[environment], and lights that a sky brings. @param layer  the view layer   @param painter  painting.AtOnce or Beside"""
    table = Table("[environment]")
    world, lights = world_of(depsgraph, scene, layer), []
    tree = tree_of(world) if world is not None else None
    shader = output_of(tree, "Surface")
    if world is not None and tree is None:
        table.set(radiance=world.color)
    elif shader is not None:
        lights = _Background(world, depsgraph, folder, painter, notes).fill(table, shader)
    if world is not None:
        _say_the_rest(world, notes)
    visible = getattr(getattr(world, "cycles_visibility", None), "camera", True)
    if scene.render.film_transparent or not visible:
        table.set(visible_to_camera=False)
        if getattr(getattr(scene, "cycles", None), "film_transparent_glass", False) and scene.render.film_transparent:
            notes.say("Film", "transparent glass is left out: the world is seen through glass")
    return [table, *lights]


def _say_the_rest(world, notes):
    visibility = getattr(world, "cycles_visibility", None)
    unseen = [k for k in ("diffuse", "glossy", "transmission", "scatter") if not getattr(visibility, k, True)]
    if unseen:
        notes.say(world.name, f"it is seen by rays of every kind in brume, {' and '.join(unseen)} too")


class _Background:
    """Of a world's shader."""

    def __init__(self, world, depsgraph, folder, painter, notes):
        self._name = world.name
        self._world, self._depsgraph, self._folder, self._painter, self._notes = world, depsgraph, folder, painter, notes

    def fill(self, table, shader):
        """Returns lights."""
        self._look_at_camera_rays(table, shader)
        if shader.node.type == "BACKGROUND":
            colour = shader.input("Color").resolve()
            strength = self._constant(shader.input("Strength"))
            if strength is not None and colour.socket.is_output:
                if colour.node.type == "TEX_SKY":
                    return sky_tables(table, colour.node, float(strength), self._world.name, self._notes)
                if colour.node.type == "TEX_ENVIRONMENT" and self._picture(table, colour, float(strength)):
                    return []
        constant = self._constant_radiance(shader)
        if constant is not None:
            table.set(radiance=np.maximum(constant, 0))
        else:
            self._bake(table, shader)
        return []

    def _constant(self, plug):
        try:
            return Values().number(plug)
        except UnknownNode:
            return None

    def _look_at_camera_rays(self, table, shader):
        """Of worlds that look another way to the camera, brume knows those that it does not see."""
        if not any(node.type == "LIGHT_PATH" for node in nodes_of(self._world.node_tree)):
            return
        seen = self._constant_radiance(shader, camera=1.0)
        if seen is not None and not seen.any():
            table.set(visible_to_camera=False)
        else:
            self._notes.say(self._world.name, "the camera sees what lights the scene, whatever Light Path chooses for it")

    def _constant_radiance(self, shader, camera=0.0):
        try:
            value = np.asarray(self._radiance(shader, Values(_LightPath(camera))))
        except UnknownNode:
            return None
        return value if value.ndim == 1 else None

    def _radiance(self, plug, values):
        """Of Backgrounds, sums and mixtures. @throws UnknownNode"""
        if not plug.socket.is_output:
            return np.zeros(3)
        node = plug.node
        if node.type in ("BACKGROUND", "EMISSION"):
            return values.colour(plug.input("Color")) * np.asarray(values.number(plug.input("Strength")))[..., None]
        if node.type == "ADD_SHADER":
            return sum(self._radiance(part.resolve(), values) for part in plug.inputs())
        if node.type == "MIX_SHADER":
            share = np.clip(np.asarray(values.number(plug.input("Fac", "Factor"))), 0, 1)[..., None]
            a, b = (self._radiance(part.resolve(), values) for part in plug.inputs()[1:])
            return a * (1 - share) + b * share
        raise UnknownNode(node.bl_label)

    def _picture(self, table, colour, strength):
        """Names the picture of an Environment Texture, turned as it is; False: it has to be computed."""
        node, image = colour.node, colour.node.image
        path = file_of(image) if image is not None else None
        if path is None or node.projection != "EQUIRECTANGULAR" or not is_linear(image):
            return False
        if not path.lower().endswith((".exr", ".hdr", ".pic")):
            return False
        axes = np.eye(3)
        vector = colour.input("Vector")
        if vector.resolve().socket.is_output:
            try:
                axes = Values(_Directions(np.eye(3))).colour(vector)
                turned = Values(_Directions(-np.eye(3))).colour(vector)
            except UnknownNode:
                return False
            if np.shape(axes) != (3, 3) or np.abs(axes + turned).max() > 1e-5 or np.abs(axes @ axes.T - np.eye(3)).max() > 1e-5:
                return False  # no rotation
            if np.linalg.det(axes) < 0:
                return False
        picture_from_world = np.asarray(axes).T
        _place(table, picture_from_world)
        table.set(file=path, radiance=[strength] * 3)
        return True

    def _bake(self, table, shader):
        """Writes a picture of what the nodes compute."""
        width, height = BAKED
        images = [n.image for n in nodes_of(self._world.node_tree) if n.type == "TEX_ENVIRONMENT" and n.image is not None]
        for image in images:
            if image.size[0] > width:
                width, height = min(image.size[0], LARGEST[0]), min(image.size[0] // 2, LARGEST[1])
        try:
            seen = self._computed(shader, np.random.default_rng(1).normal(size=(PROBES, 3)), self._notes)
        except UnknownNode as unknown:
            self._notes.say(self._world.name, f"depends on {unknown}, which brume lacks; it is black")
            return
        key = ("world", signature(self._world.node_tree), self._folder.pictures.serials(images))
        if key not in self._folder.written:
            try:
                painted = self._painter.painted(key, ("world",), lambda: self._painting(shader, width, height))
            except Pending:
                table.set(radiance=mean_of(seen))
                return
            self._folder.written[key] = Texture(None, moves=any(map(moves, images))).painted(self._name, *painted)
        written = self._folder.written[key]
        written.remarks.tell(self._notes)
        table.set(file=self._folder.named(written.path), radiance=[written.peak] * 3)
        self._notes.say(self._world.name, f"its nodes are taken as a picture of {width} x {height}")

    def _painting(self, shader, width, height):
        trees = {}
        frozen_ = frozen(shader, self._depsgraph, trees)
        images_read(trees, self._folder.pictures)

        def radiance(first, last):
            row, column = np.divmod(np.arange(first, last), width)
            theta, phi = (row + 0.5) / height * math.pi, (column + 0.5) / width * 2 * math.pi - math.pi
            # Brume's lat-long pictures: the middle faces +y, right of it is +x.
            directions = np.stack([np.sin(theta) * np.sin(phi), np.sin(theta) * np.cos(phi), np.cos(theta)], -1)
            return self._computed(frozen_, directions, Notes())

        return Painting((width, height), radiance, is_light=True)

    def _computed(self, shader, directions, notes):
        """(N, 3). @throws UnknownNode"""
        directions = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
        leaves = _Directions(directions, lambda plug, direction: self._environment(plug, direction, notes))
        return np.maximum(np.broadcast_to(self._radiance(shader, Values(leaves)), directions.shape), 0)

    def _environment(self, plug, direction, notes):
        """Of an Environment Texture."""
        node = plug.node
        if node.image is None:
            return np.zeros(3)
        if node.projection != "EQUIRECTANGULAR":
            raise UnknownNode(f"Environment Texture ({node.projection.lower()})")
        x, y, z = (direction[..., c] for c in range(3))
        u, v = 0.5 - np.arctan2(y, x) / (2 * math.pi), np.arctan2(z, np.hypot(x, y)) / math.pi + 0.5
        picture = self._folder.pictures.of(node.image)
        picture.say_what_it_is(notes, self._name)
        return picture.looked_up(u, v)


def _place(table, picture_from_world):
    """up and rotation of a picture that Blender turns. @param picture_from_world  rotation, for columns"""
    up, middle = picture_from_world.T[:, 2], picture_from_world.T[:, 0]  # Blender's middle is +x of the picture's space
    reference = np.array([0, 1, 0]) if abs(up[2]) > 0.5 else np.array([0, 0, -1])
    right = np.cross(reference, up)
    right /= np.linalg.norm(right)
    forward = np.cross(up, right)
    table.set(up=up, rotation=-math.degrees(math.atan2(middle @ right, middle @ forward)))


class _LightPath:
    """Leaf: whether a ray is the camera's."""

    def __init__(self, camera):
        self._camera = camera

    def __call__(self, plug):
        return self._camera if plug.node.type == "LIGHT_PATH" and plug.socket.name == "Is Camera Ray" else None


class _Directions(_LightPath):
    """Leaves of a world's shader, for some directions. @param environment  function of an
    Environment Texture's plug, and directions; None: there is none"""

    def __init__(self, directions, environment=None):
        super().__init__(0.0)
        self._directions, self._environment = directions, environment

    def generated(self):
        return self._directions

    def __call__(self, plug):
        node = plug.node
        if node.type == "TEX_COORD" and plug.socket.name in ("Generated", "Normal", "Object"):
            return self._directions if node.object is None else None
        if node.type == "NEW_GEOMETRY" and plug.socket.name == "Position":
            return self._directions
        if node.type == "NEW_GEOMETRY" and plug.socket.name in ("Normal", "True Normal", "Incoming"):
            return -self._directions
        if node.type == "TEX_ENVIRONMENT" and self._environment is not None:
            vector = plug.input("Vector")
            linked = vector.resolve().socket.is_output
            direction = Values(self).colour(vector) if linked else self._directions
            return self._environment(plug, direction)
        return super().__call__(plug)
