"""What nodes give at points of a mesh: coordinates, normals, UV maps, colour attributes, images."""

import numpy as np

from .node_values import UnknownNode, Values
from .nodes import as_the_camera_sees
from .pictures import is_cut


class SurfacePoints:
    """Leaves of surface shaders.

    @param triangles  that hold the points, (N,)   @param weights  of their corners, (N, 3)
    @param place      of the mesh (places.Place)"""

    def __init__(self, geometry, triangles, weights, place, pictures, notes, name):
        self._pictures = pictures
        self._geometry, self._triangles, self._weights = geometry, triangles, weights
        self._place, self._notes, self._name = place, notes, name
        self._points = self._between(geometry.points[geometry.vertices[triangles]]).astype(float)

    def __call__(self, plug):
        node, name = plug.node, plug.socket.name
        if node.type == "TEX_COORD" and name == "UV":
            return self._uv("")
        if node.type == "UVMAP":
            return self._uv(node.uv_map)
        if node.type in ("TEX_COORD", "NEW_GEOMETRY") and name in ("Normal", "True Normal"):
            return self._normals()
        if node.type == "TEX_IMAGE":
            return self._image(plug)
        if node.type == "VERTEX_COLOR" or (node.type == "ATTRIBUTE" and node.attribute_type == "GEOMETRY"):
            return self._attribute(node.layer_name if node.type == "VERTEX_COLOR" else node.attribute_name, plug)
        seen = as_the_camera_sees(plug, lambda text: self._notes.say(self._name, "the material " + text))
        if seen is not None:
            return seen
        return self._place.leaf(plug, self._points)

    def generated(self):
        return self._place.generated(self._points)

    def _between(self, values):
        """Of values at the corners, (N, 3, channels)."""
        return np.einsum("nc,ncd->nd", self._weights, values)

    def _uv(self, name):
        uv = self._geometry.uv(name)
        if uv is None:
            return np.zeros(3)
        return np.pad(self._between(uv[self._geometry.loops[self._triangles]]), ((0, 0), (0, 1)))

    def _normals(self):
        a, b, c = np.moveaxis(self._geometry.points[self._geometry.vertices[self._triangles]].astype(float), 1, 0)
        n = np.cross(b - a, c - a)
        return n / np.maximum(np.linalg.norm(n, axis=-1, keepdims=True), 1e-30)

    def _image(self, plug):
        node = plug.node
        if node.projection != "FLAT":
            raise UnknownNode(f"Image Texture ({node.projection.lower()})")
        vector = plug.input("Vector")
        uv = np.asarray(Values(self).colour(vector)) if vector.resolve().socket.is_output else self._uv("")
        uv = np.broadcast_to(uv, (len(self._points), 3))
        picture = self._pictures.of(node.image)
        if plug.socket.name == "Alpha":
            return picture.alpha_looked_up(uv[:, 0], uv[:, 1] % 1.0)
        picture.say_what_it_is(self._notes, self._name)
        return picture.looked_up(uv[:, 0], uv[:, 1] % 1.0, is_cut(node, picture), repeat_v=True)

    def _attribute(self, name, plug):
        colours = self._geometry.colours(name)
        if colours is None:
            uv = self._geometry.uv(name) if name else None
            if uv is None:
                return np.zeros(3) if plug.socket.type != "VALUE" else 0.0
            return self._uv(name)
        value = self._between(colours[self._geometry.loops[self._triangles]])
        if plug.socket.name == "Alpha":
            return value[:, 3]
        return value[:, :3].mean(-1) if plug.socket.type == "VALUE" else value[:, :3]


class Surface:
    """The triangles of a mesh that have one material."""

    def __init__(self, geometry, chosen, key, place, pictures, notes, name):
        """@param chosen  truth for each triangle   @param key  of geometry and triangles"""
        self.triangles, self.key, self.place = np.flatnonzero(chosen), key, place
        self._geometry, self._pictures, self._notes, self._name = geometry, pictures, notes, name

    @property
    def count(self):
        return len(self.triangles)

    def at(self, triangles, weights, notes=None):
        """@param notes  Notes of what is said of it; the surface's own unless given"""
        notes = self._notes if notes is None else notes
        return SurfacePoints(self._geometry, triangles, weights, self.place, self._pictures, notes, self._name)

    def spread(self, count):
        """(triangles, weights) of points on triangles chosen by chance."""
        random = np.random.default_rng(1)
        u, v = random.random((2, count))
        u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
        return self.triangles[random.integers(self.count, size=count)], np.stack([1 - u - v, u, v], -1)
