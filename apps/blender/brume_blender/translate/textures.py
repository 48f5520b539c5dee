"""Colours of surfaces: one colour, or a picture by a UV map."""

from dataclasses import dataclass

import numpy as np

from .node_values import UnknownNode, Values
from .nodes import as_the_camera_sees, signature
from .pictures import NoPicture, alpha_of, file_of, is_cut, is_linear, texels_of, write_exr

PROBES = 2048  # points by which colours are told apart
TEXELS = 1 << 18  # of a picture of triangles, unless these are more
STAND_IN = 0.5  # for nodes without a counterpart


class Atlas:
    """A picture in which each triangle has n x n texels: its corners are the middles of the first one, the last of the first row, and
    the first of the last row."""

    def __init__(self, triangles, texels):
        self._count = triangles
        self._n = int(min(max((texels / triangles) ** 0.5, 2), 512))
        self._across = int(np.ceil(triangles**0.5))
        self._down = -(-triangles // self._across)

    def key(self):
        return self._count, self._n

    def points(self, triangles):
        """(triangles, weights of their corners) of the texels, triangle by triangle. @param triangles  their numbers"""
        steps = np.arange(self._n) / (self._n - 1)
        v, u = (a.ravel() for a in np.meshgrid(steps, steps, indexing="ij"))
        return np.repeat(triangles, self._n**2), np.tile(np.stack([1 - u - v, u, v], -1), (len(triangles), 1))

    def picture(self, colours):
        n, across, down = self._n, self._across, self._down
        cells = np.zeros((across * down, n, n, 3), np.float32)
        cells[: self._count] = colours.reshape(-1, n, n, 3)
        return cells.reshape(down, across, n, n, 3).transpose(0, 2, 1, 3, 4).reshape(down * n, across * n, 3)

    def uv(self):
        """Of the triangles' corners, (triangles, 3, 2)."""
        row, column = np.divmod(np.arange(self._count), self._across)
        first = np.stack([column, row], -1)[:, None, :] * self._n + 0.5
        corners = first + np.array([[0, 0], [1, 0], [0, 1]]) * (self._n - 1)
        uv = corners / (self._n * np.array([self._across, self._down]))
        uv[..., 1] = 1 - uv[..., 1]
        return uv


@dataclass
class Texture:
    """A picture, and where it lies: uv = matrix * map(uv) + offset, or by an atlas of the triangles."""

    path: str
    uv_map: str = ""
    matrix: np.ndarray = None
    offset: np.ndarray = None
    atlas: object = None

    def placement(self):
        """Equal where a mesh's corners are at the same place of the picture."""
        return self.atlas.key() if self.atlas is not None else (self.uv_map, self.matrix.tobytes(), self.offset.tobytes())


class Textures:
    """Pictures of a render, each written once."""

    def __init__(self, folder, notes):
        self._folder, self._notes = folder, notes
        self._written = folder.written

    def of(self, plug, gain, name, surface):
        """(colour, Texture or None) of a colour.
        @param plug  of it, or a Blend or Rest of shares.py
        @param gain  on it   @param surface  surface_points.Surface, for what is no picture"""
        wanted = _Wanted(plug)
        try:
            colour = np.asarray(wanted.of(Values(self._rays(name))))
            if colour.ndim == 1:
                return np.clip(gain * colour, 0, 1), None
        except UnknownNode:
            pass
        try:
            return np.ones(3), self._texture(wanted, gain, name)
        except (UnknownNode, NoPicture):
            return self._baked(wanted, gain, name, surface)

    def baked(self, plug, gain, name, surface):
        """As of(), in texels of each triangle for itself, so that several lie alike."""
        return self._baked(_Wanted(plug), gain, name, surface)

    def probed(self, plug, name, surface):
        """Its colours at points chosen by chance, (N, 3)."""
        stand_in = lambda p, _: STAND_IN if p.socket.type == "VALUE" else np.full(3, STAND_IN)  # noqa: E731
        triangles, weights = surface.spread(PROBES)
        return np.broadcast_to(_Wanted(plug).of(Values(surface.at(triangles, weights), stand_in)), (len(triangles), 3))

    def peak(self, plug, name, surface):
        """(3,): what no channel of it exceeds, as far as is known: of images exactly, of others by points chosen by chance."""
        try:
            values = _Wanted(plug).of(Values(self._texels([], name)))
            return np.atleast_2d(values).max(0)
        except (UnknownNode, NoPicture):
            return 1.25 * self.probed(plug, name, surface).max(0)

    def _rays(self, name):
        """Leaves that are known without a point."""
        return lambda plug: as_the_camera_sees(plug, lambda text: self._notes.say(name, "the material " + text))

    def _baked(self, wanted, gain, name, surface):
        stand_ins = []

        def stand_in(p, lacking):
            stand_ins.append(lacking)
            return STAND_IN if p.socket.type == "VALUE" else np.full(3, STAND_IN)

        def colours(triangles, weights):
            values = wanted.of(Values(surface.at(triangles, weights), stand_in))
            return np.clip(gain * np.broadcast_to(values, (len(triangles), 3)), 0, 1).astype(np.float32)

        probed = colours(*surface.spread(PROBES))
        if stand_ins:
            what = f"the material's {wanted.name} depends on {stand_ins[0]}, which brume lacks"
            self._notes.say(name, f"{what}; {STAND_IN} is taken for it")
        if np.ptp(probed, axis=0).max() < 1e-6:
            return probed[0].astype(float), None
        key = (*surface.key, wanted.key(), probed.tobytes(), tuple(np.broadcast_to(gain, 3)))
        if key not in self._written:
            atlas = Atlas(surface.count, TEXELS)
            path = self._folder.new(".exr", "texture", name)
            write_exr(path, atlas.picture(colours(*atlas.points(surface.triangles))))
            self._written[key] = Texture(path, atlas=atlas)
        return np.ones(3), self._written[key]

    def _texture(self, wanted, gain, name):
        """@throws UnknownNode, NoPicture"""
        found = []
        key = (wanted.key(), tuple(np.broadcast_to(gain, 3)), *wanted.signatures())
        if key in self._written:
            return self._written[key]
        colours = wanted.of(Values(self._texels(found, name)))
        image_plug = found[0]
        node, image = image_plug.node, image_plug.node.image
        self._say_settings(node, name)
        uv_map, matrix, offset = self._coordinates(image_plug)
        path = file_of(image)
        direct = np.all(gain == 1) and wanted.is_just(image_plug) and path is not None and _read_alike(image, path)
        direct = direct and not (is_cut(node) and alpha_of(image).min() < 1)
        if not direct:
            path = self._folder.new(".exr", "texture", image.name)
            width, height = image.size
            write_exr(path, np.clip(gain * colours, 0, 1).reshape(height, width, 3))
        self._written[key] = Texture(path, uv_map, matrix, offset)
        return self._written[key]

    def _texels(self, found, name):
        """Leaves at all texels of one image. @param found  plugs of it, which are added"""
        other = self._rays(name)

        def leaves(p):
            if p.node.type != "TEX_IMAGE":
                return other(p)
            if p.node.image is None:
                raise NoPicture("an Image Texture without an image")
            if found and (p.node.image != found[0].node.image or not _lie_alike(p, found[0])):
                raise UnknownNode("several images")
            found.append(p)
            if p.socket.name == "Alpha":
                return alpha_of(p.node.image).ravel()
            return texels_of(p.node, self._notes, name).reshape(-1, 3)

        return leaves

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


class _Wanted:
    """A colour that nodes compute. @param what  its plug, or a Blend or Rest"""

    def __init__(self, what):
        self._what, self._blended = what, hasattr(what, "plugs")
        self._plugs = what.plugs() if self._blended else [what]
        self.name = "mixture" if self._blended else f"'{what.socket.name}'"

    def of(self, values):
        return self._what.of(values) if self._blended else values.colour(self._what)

    def key(self):
        plugs = self._plugs if self._blended else [self._what.resolve()]
        return (type(self._what).__name__, *(plug.key() for plug in plugs))

    def signatures(self):
        heres = [plug.resolve() for plug in self._plugs]
        return [signature(node.id_data) for here in heres for node in (here.node, *here.groups)]

    def is_just(self, plug):
        """Whether it is what an output of an image is."""
        return not self._blended and self._what.resolve().key() == plug.key() and plug.socket.name != "Alpha"


def _lie_alike(a, b):
    """Whether two Image Textures are looked up at the same place."""
    return a.node == b.node or a.input("Vector").resolve().key() == b.input("Vector").resolve().key()


def _read_alike(image, path):
    """Whether brume reads the file as Blender does: PNG and JPEG are sRGB there, HDR and EXR linear."""
    kind = path.rsplit(".", 1)[-1].lower()
    if kind in ("png", "jpg", "jpeg"):
        return image.colorspace_settings.name == "sRGB"
    return kind in ("hdr", "exr") and is_linear(image)
