"""Colours of surfaces: one colour, or a picture by a UV map."""

from dataclasses import dataclass

import numpy as np

from .node_values import UnknownNode, Values
from .pictures import NoPicture, file_of, is_linear, pixels_of, write_exr


@dataclass
class Texture:
    """A picture, and where it lies: uv = matrix * map(uv) + offset."""

    path: str
    uv_map: str
    matrix: np.ndarray
    offset: np.ndarray


class Textures:
    """Pictures of a render, each written once."""

    def __init__(self, folder, notes):
        self._folder, self._notes = folder, notes
        self._written = {}

    def of(self, plug, name):
        """(colour, Texture or None) of a colour's plug."""
        try:
            colour = np.asarray(Values().colour(plug))
            if colour.ndim == 1:
                return np.clip(colour, 0, 1), None
        except UnknownNode:
            pass
        try:
            return np.ones(3), self._texture(plug, name)
        except (UnknownNode, NoPicture) as unknown:
            default = np.array(plug.socket.default_value[:3])
            self._notes.say(
                name,
                f"the material's '{plug.socket.name}' depends on {unknown}, which brume lacks; {[round(float(c), 3) for c in default]} is taken",
            )
            return np.clip(default, 0, 1), None

    def _texture(self, plug, name):
        """@throws UnknownNode, NoPicture"""
        found = []

        def leaves(p):
            if p.node.type != "TEX_IMAGE":
                return None
            if p.node.image is None:
                raise NoPicture("an Image Texture without an image")
            if p.socket.name == "Alpha":
                raise UnknownNode("the alpha of an image")
            if found and p.node.image != found[0].node.image:
                raise UnknownNode("several images")
            found.append(p)
            return pixels_of(p.node.image, self._notes, name).reshape(-1, 3)

        key = plug.resolve().key()
        if key in self._written:
            return self._written[key]
        colours = Values(leaves).colour(plug)
        image_plug = found[0]
        node, image = image_plug.node, image_plug.node.image
        self._say_settings(node, name)
        uv_map, matrix, offset = self._coordinates(image_plug)
        path = file_of(image)
        direct = plug.resolve().key() == image_plug.key() and path is not None and _read_alike(image, path)
        if not direct:
            path = self._folder.new(".exr", "texture", image.name)
            width, height = image.size
            write_exr(path, np.clip(colours, 0, 1).reshape(height, width, 3))
        self._written[key] = Texture(path, uv_map, matrix, offset)
        return self._written[key]

    def _say_settings(self, node, name):
        if node.projection != "FLAT":
            self._notes.say(name, f"the material's image is projected {node.projection.lower()}; it lies flat by its UV map")
        if node.extension != "REPEAT":
            self._notes.say(name, f"the material's image ({node.extension.lower()}) repeats beyond its edges")
        if node.interpolation not in ("Linear", "Smart"):
            self._notes.say(name, f"the material's image ({node.interpolation.lower()}) is interpolated linearly")

    def _coordinates(self, image_plug):
        """(UV map, matrix, offset). @throws UnknownNode: coordinates that are no affine function of a UV map"""
        vector = image_plug.input("Vector")
        maps = set()

        def leaves_at(points):
            def leaves(p):
                if p.node.type == "UVMAP":
                    maps.add(p.node.uv_map)
                    return points
                if p.node.type == "TEX_COORD" and p.socket.name == "UV":
                    maps.add("")
                    return points
                return None

            return leaves

        if not vector.resolve().socket.is_output:
            return "", np.eye(2), np.zeros(2)
        points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.3, 0.8, 0]], float)
        at = np.asarray(Values(leaves_at(points)).colour(vector))
        if len(maps) != 1 or at.shape != (4, 3):
            raise UnknownNode("texture coordinates that are no UV map")
        matrix, offset = (at[1:3, :2] - at[0, :2]).T, at[0, :2]
        if np.abs(points[3, :2] @ matrix.T + offset - at[3, :2]).max() > 1e-6:
            raise UnknownNode("bent texture coordinates")
        return maps.pop(), matrix, offset


def _read_alike(image, path):
    """Whether brume reads the file as Blender does: PNG and JPEG are sRGB there, HDR and EXR linear."""
    kind = path.rsplit(".", 1)[-1].lower()
    if kind in ("png", "jpg", "jpeg"):
        return image.colorspace_settings.name == "sRGB"
    return kind in ("hdr", "exr") and is_linear(image)
