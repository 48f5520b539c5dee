"""Colours of surfaces: one colour, or a picture by a UV map."""

from dataclasses import dataclass, field

import numpy as np

from .beside import Pending
from .frozen import frozen, images_read
from .node_values import UnknownNode, Values
from .nodes import as_the_camera_sees, nodes_of, signature
from .notes import Notes
from .painting import Painting, mean_of
from .pictures import file_of, is_cut, is_linear, moves, repaired_text

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

    @property
    def size(self):
        """(width, height) of the picture."""
        return self._across * self._n, self._down * self._n

    def points(self, triangles, first, last):
        """(triangles, weights of their corners) of the picture's texels from one to another, row by row; those that belong to no
        triangle are the last one's. @param triangles  their numbers"""
        n = self._n
        row, column = np.divmod(np.arange(first, last), self._across * n)
        (cell_y, y), (cell_x, x) = np.divmod(row, n), np.divmod(column, n)
        v, u = y / (n - 1), x / (n - 1)
        cell = np.minimum(cell_y * self._across + cell_x, self._count - 1)
        return triangles[cell], np.stack([1 - u - v, u, v], -1)

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
    """A picture, and where it lies: uv = matrix * map(uv) + offset, or by an atlas of the triangles. It is to be multiplied by
    a number."""

    path: str  # None: it is being painted
    peak: float = 1.0
    remarks: Notes = field(default_factory=Notes)  # which every translation that shows it says
    moves: bool = False  # from frame to frame, of itself
    uv_map: str = ""
    matrix: np.ndarray = None
    offset: np.ndarray = None
    atlas: object = None

    def placement(self):
        """Equal where a mesh's corners are at the same place of the picture."""
        return self.atlas.key() if self.atlas is not None else (self.uv_map, self.matrix.tobytes(), self.offset.tobytes())

    def painted(self, name, path, peak, repaired):
        """It has been. @param name  of the material or world   @return itself"""
        self.path, self.peak = path, peak
        if repaired:
            self.remarks.say(name, f"the picture that its nodes compute {repaired_text(repaired)}")
        return self


class Textures:
    """Pictures of a render, each written once."""

    def __init__(self, folder, painter, notes):
        """@param painter  painting.AtOnce or Beside"""
        self._folder, self._painter, self._notes = folder, painter, notes
        self._written, self._pictures = folder.written, folder.pictures

    def of(self, plug, gain, name, surface, is_light=False):
        """(colour, Texture or None) of a colour. While a picture is being painted, its mean.
        @param plug  of it, or a Blend or Rest of shares.py
        @param gain  on it   @param surface  surface_points.Surface, for what is no picture   @param is_light  it may exceed 1"""
        wanted = _Wanted(plug, is_light)
        try:
            colour = np.asarray(wanted.of(Values(self._rays(name))))
            if colour.ndim == 1:
                return wanted.clipped(gain * colour), None
        except UnknownNode:
            pass
        try:
            return self._texture(wanted, gain, name, surface)
        except UnknownNode:
            return self._baked(wanted, gain, name, surface)

    def baked(self, plug, gain, name, surface, is_light=False):
        """As of(), in texels of each triangle for itself, so that several lie alike."""
        return self._baked(_Wanted(plug, is_light), gain, name, surface)

    def probed(self, plug, name, surface):
        """Its colours at points chosen by chance, (N, 3)."""
        triangles, weights = surface.spread(PROBES)
        return np.broadcast_to(_Wanted(plug).of(Values(surface.at(triangles, weights), _stand_in)), (len(triangles), 3))

    def _rays(self, name):
        """Leaves that are known without a point."""
        return lambda plug: as_the_camera_sees(plug, lambda text: self._notes.say(name, "the material " + text))

    def _baked(self, wanted, gain, name, surface):
        stand_ins = []

        def stand_in(p, lacking):
            stand_ins.append(lacking)
            return _stand_in(p, lacking)

        triangles, weights = surface.spread(PROBES)
        values = wanted.of(Values(surface.at(triangles, weights), stand_in))
        probed = wanted.clipped(gain * np.broadcast_to(values, (len(triangles), 3))).astype(np.float32)
        if stand_ins:
            what = f"the material's {wanted.name} depends on {stand_ins[0]}, which brume lacks"
            self._notes.say(name, f"{what}; {STAND_IN} is taken for it")
        if np.ptp(probed, axis=0).max() < 1e-6:
            return probed[0].astype(float), None
        serials = self._pictures.serials(wanted.images())
        key = (*surface.key, wanted.key(), probed.tobytes(), tuple(np.broadcast_to(gain, 3)), serials)
        atlas = Atlas(surface.count, TEXELS)

        def painting():
            frozen_ = wanted.frozen(surface.place, self._pictures)

            def colours(first, last):
                at = surface.at(*atlas.points(surface.triangles, first, last), Notes())
                return gain * np.broadcast_to(frozen_.of(Values(at, _stand_in)), (last - first, 3))

            return Painting(atlas.size, colours, wanted.is_light)

        return self._painted(key, name, name, painting, Texture(None, atlas=atlas, moves=wanted.moves()), probed)

    def _texture(self, wanted, gain, name, surface):
        """@throws UnknownNode: it is not of one image"""
        found = []
        key = (wanted.key(), tuple(np.broadcast_to(gain, 3)), *wanted.signatures(), self._pictures.serials(wanted.images()))
        if key in self._written:
            return self._known(key)
        remarks = Notes()
        values = wanted.of(Values(self._texels(found, name, lambda p: p.some(), remarks)))
        image_plug = found[0]
        node, picture = image_plug.node, self._pictures.of(image_plug.node.image)
        _say_settings(node, name, remarks)
        remarks.tell(self._notes)
        uv_map, matrix, offset = self._coordinates(image_plug)
        made = Texture(None, uv_map=uv_map, matrix=matrix, offset=offset, moves=picture.moves, remarks=remarks)
        path = file_of(node.image)
        direct = np.all(gain == 1) and wanted.is_just(image_plug) and path is not None and _read_alike(node.image, path)
        if direct and not (wanted.is_light and node.image.is_float) and (not is_cut(node, picture) or picture.is_opaque()):
            made.path = path
            return np.ones(3), self._written.setdefault(key, made)

        def painting():
            frozen_ = wanted.frozen(surface.place, self._pictures)

            def colours(first, last):
                texels = lambda _: np.divmod(np.arange(first, last), picture.size[0])  # noqa: E731
                values = frozen_.of(Values(self._texels([], name, texels, Notes())))
                return gain * np.broadcast_to(values, (last - first, 3))

            return Painting(picture.size, colours, wanted.is_light)

        return self._painted(key, name, picture.name, painting, made, wanted.clipped(gain * np.atleast_2d(values)))

    def _painted(self, key, name, file, painting, made, values):
        """(colour, Texture). @param name  of the material   @param file  of the file   @param made  the Texture without its path
        @param values  some of what is painted, (N, 3)"""
        if key not in self._written:
            try:
                self._written[key] = made.painted(name, *self._painter.painted(key, ("texture", file), painting))
            except Pending:
                return mean_of(values), made
        return self._known(key)

    def _known(self, key):
        written = self._written[key]
        written.remarks.tell(self._notes)
        return np.full(3, written.peak), written

    def _texels(self, found, name, texels, notes):
        """Leaves at texels of one image. @param found  plugs of it, which are added   @param texels  function of its Picture: rows
        and columns"""

        def leaves(p):
            if p.node.type != "TEX_IMAGE":
                return as_the_camera_sees(p, lambda text: notes.say(name, "the material " + text))
            if p.node.image is None:
                raise UnknownNode("an Image Texture without an image")
            if found and (p.node.image != found[0].node.image or not _lie_alike(p, found[0])):
                raise UnknownNode("several images")
            found.append(p)
            picture = self._pictures.of(p.node.image)
            if p.socket.name == "Alpha":
                return picture.alpha_at(*texels(picture))
            picture.say_what_it_is(notes, name)
            return picture.at(*texels(picture), is_cut(p.node, picture))

        return leaves

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


def _say_settings(node, name, notes):
    if node.projection != "FLAT":
        notes.say(name, f"the material's image is projected {node.projection.lower()}; it lies flat by its UV map")
    if node.extension != "REPEAT":
        notes.say(name, f"the material's image ({node.extension.lower()}) repeats beyond its edges")
    if node.interpolation not in ("Linear", "Smart"):
        notes.say(name, f"the material's image ({node.interpolation.lower()}) is interpolated linearly")


def _stand_in(plug, lacking):
    """For nodes without a counterpart."""
    return STAND_IN if plug.socket.type == "VALUE" else np.full(3, STAND_IN)


class _Wanted:
    """A colour that nodes compute. @param what  its plug, or a Blend or Rest   @param is_light  it may exceed 1"""

    def __init__(self, what, is_light=False):
        self._what, self._blended, self.is_light = what, hasattr(what, "plugs"), is_light
        self._plugs = what.plugs() if self._blended else [what]
        self.name = "mixture" if self._blended else f"'{what.socket.name}'"

    def of(self, values):
        return self._what.of(values) if self._blended else values.colour(self._what)

    def clipped(self, values):
        return np.maximum(values, 0) if self.is_light else np.clip(values, 0, 1)

    def frozen(self, place, pictures):
        """The same, for other threads. @param pictures  pictures.Pictures"""
        change = lambda plug: frozen(plug, place.depsgraph, place.trees)  # noqa: E731
        made = _Wanted(self._what.with_plugs(change) if self._blended else change(self._what), self.is_light)
        images_read(place.trees, pictures)
        return made

    def moves(self):
        """Whether it shows images that are others at other frames."""
        return any(map(moves, self.images()))

    def images(self):
        """Of all nodes where it is computed, and of the groups in there."""
        nodes = [node for plug in self._plugs for tree in _trees_of(plug) for node in nodes_of(tree)]
        return [node.image for node in nodes if getattr(node, "image", None) is not None]

    def key(self):
        plugs = self._plugs if self._blended else [self._what.resolve()]
        return (type(self._what).__name__, *(plug.key() for plug in plugs))

    def signatures(self):
        return [signature(tree) for plug in self._plugs for tree in _trees_of(plug.resolve())]

    def is_just(self, plug):
        """Whether it is what an output of an image is."""
        return not self._blended and self._what.resolve().key() == plug.key() and plug.socket.name != "Alpha"


def _trees_of(plug):
    return [node.id_data for node in (plug.node, *plug.groups)]


def _lie_alike(a, b):
    """Whether two Image Textures are looked up at the same place."""
    return a.node == b.node or a.input("Vector").resolve().key() == b.input("Vector").resolve().key()


def _read_alike(image, path):
    """Whether brume reads the file as Blender does: PNG and JPEG are sRGB there, HDR and EXR linear."""
    kind = path.rsplit(".", 1)[-1].lower()
    if kind in ("png", "jpg", "jpeg"):
        return image.colorspace_settings.name == "sRGB"
    return kind in ("hdr", "exr") and is_linear(image)
