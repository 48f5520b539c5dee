"""Light from infinitely far away: a colour, a lat-long picture, or a sky."""

import math

import numpy as np

from .node_values import UnknownNode, Values
from .nodes import output_of, signature, tree_of
from .pictures import NoPicture, file_of, is_linear, looked_up, pixels_of, write_exr
from .sky import sky_tables
from .toml_text import Table

BAKED = (1024, 512)  # of a world that is computed
LARGEST = (8192, 4096)


def world_of(depsgraph, scene, layer):
    """Evaluated; None: the layer has none."""
    world = getattr(layer, "world_override", None) or scene.world  # Blender 4.3
    return world.evaluated_get(depsgraph) if world is not None and layer.use_sky else None


def world_tables(depsgraph, scene, layer, folder, notes):
    """[environment], and lights that a sky brings. @param layer  the view layer"""
    table = Table("[environment]")
    world, lights = world_of(depsgraph, scene, layer), []
    tree = tree_of(world) if world is not None else None
    shader = output_of(tree, "Surface")
    if world is not None and tree is None:
        table.set(radiance=world.color)
    elif shader is not None:
        lights = _Background(world, folder, notes).fill(table, shader)
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

    def __init__(self, world, folder, notes):
        self._world, self._folder, self._notes = world, folder, notes

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
        if not any(node.type == "LIGHT_PATH" for node in self._world.node_tree.nodes):
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
                axes = Values(_Directions(np.eye(3), self)).colour(vector)
                turned = Values(_Directions(-np.eye(3), self)).colour(vector)
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
        for image in _images(self._world.node_tree):
            if image.size[0] > width:
                width, height = min(image.size[0], LARGEST[0]), min(image.size[0] // 2, LARGEST[1])
        key = ("world", signature(self._world.node_tree))
        if key not in self._folder.written:
            self._folder.written[key] = self._written(shader, width, height)
        if self._folder.written[key] is not None:
            table.set(file=self._folder.named(self._folder.written[key]), radiance=[1, 1, 1])
            self._notes.say(self._world.name, f"its nodes are taken as a picture of {width} x {height}")

    def _written(self, shader, width, height):
        """Path of the picture; None: the world is black."""
        theta = (np.arange(height) + 0.5) / height * math.pi
        phi = (np.arange(width) + 0.5) / width * 2 * math.pi - math.pi
        # Brume's lat-long pictures: the middle faces +y, right of it is +x.
        sines = np.sin(theta)[:, None]
        directions = np.stack(
            [sines * np.sin(phi), sines * np.cos(phi), np.broadcast_to(np.cos(theta)[:, None], (height, width))], -1
        ).reshape(-1, 3)
        try:
            radiance = self._radiance(shader, Values(_Directions(directions, self)))
        except (UnknownNode, NoPicture) as unknown:
            self._notes.say(self._world.name, f"depends on {unknown}, which brume lacks; it is black")
            return None
        radiance = np.broadcast_to(radiance, (width * height, 3)).reshape(height, width, 3)
        path = self._folder.new(".exr", "world")
        write_exr(path, np.maximum(radiance, 0))
        return path

    def environment(self, plug, direction):
        """Of an Environment Texture."""
        node = plug.node
        if node.image is None:
            return np.zeros(3)
        if node.projection != "EQUIRECTANGULAR":
            raise UnknownNode(f"Environment Texture ({node.projection.lower()})")
        x, y, z = (direction[..., c] for c in range(3))
        u, v = 0.5 - np.arctan2(y, x) / (2 * math.pi), np.arctan2(z, np.hypot(x, y)) / math.pi + 0.5
        return looked_up(pixels_of(node.image, self._notes, self._world.name), u, v)


def _images(tree):
    return [n.image for n in tree.nodes if n.type == "TEX_ENVIRONMENT" and n.image is not None]


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
    """Leaves of a world's shader, for some directions."""

    def __init__(self, directions, background):
        super().__init__(0.0)
        self._directions, self._background = directions, background

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
        if node.type == "TEX_ENVIRONMENT":
            vector = plug.input("Vector")
            linked = vector.resolve().socket.is_output
            direction = Values(self).colour(vector) if linked else self._directions
            return self._background.environment(plug, direction)
        return super().__call__(plug)
