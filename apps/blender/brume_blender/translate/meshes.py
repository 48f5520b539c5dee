"""Triangles of evaluated objects, modifiers applied, as PLY files: one for each material of a mesh."""

import numpy as np

# Objects that Blender renders as meshes.
MESH_LIKE = ("MESH", "CURVE", "SURFACE", "FONT", "META")


class Geometry:
    """A mesh's corners, three for each triangle, and its vertices."""

    def __init__(self, mesh):
        mesh.calc_loop_triangles()
        count = len(mesh.loop_triangles)
        self.points = _read(mesh.vertices, "co", 3, np.float32)
        vertex_of_loop = _read(mesh.loops, "vertex_index", 1, np.int32)
        self.loops = _read(mesh.loop_triangles, "loops", 3, np.int32)
        self.materials = _read(mesh.loop_triangles, "material_index", 1, np.int32)
        self.vertices = vertex_of_loop[self.loops] if count else np.zeros((0, 3), np.int32)
        self.normals = self._corner_normals(mesh)
        uses = np.bincount(_read(mesh.loops, "edge_index", 1, np.int32), minlength=len(mesh.edges))
        self.closed = bool(np.all(uses == 2))  # around an inside
        self._uv = {layer.name: _uv_of(layer) for layer in mesh.uv_layers}
        self._colours = _colours_of(mesh, vertex_of_loop)
        self._active_colour = getattr(getattr(mesh.color_attributes, "active_color", None), "name", None)
        self._active_uv = next((layer.name for layer in mesh.uv_layers if layer.active_render), None)

    def _corner_normals(self, mesh):
        """Of every loop; None: the mesh is flat throughout."""
        smooth = np.zeros(len(mesh.polygons), bool)
        mesh.polygons.foreach_get("use_smooth", smooth)
        if not smooth.any() and not mesh.has_custom_normals:
            return None
        if hasattr(mesh, "corner_normals"):  # Blender 4.1
            return _read(mesh.corner_normals, "vector", 3, np.float32)
        mesh.calc_normals_split()
        return _read(mesh.loops, "normal", 3, np.float32)

    def spanned(self):
        """The volume that its triangles span, negative where they face inwards."""
        a, b, c = (self.points.astype(float)[self.vertices[:, i]] for i in range(3))
        return np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6

    def uv(self, name):
        """(loops, 2) of a UV map, the active one where the name is empty; None: there is none."""
        return self._uv.get(name or self._active_uv)


    def colours(self, name):
        """(loops, 4) of a colour attribute, linear, the active one where the name is empty; None: there is none."""
        return self._colours.get(name or self._active_colour)


def _colours_of(mesh, vertex_of_loop):
    found = {}
    for attribute in mesh.color_attributes:
        values = _read(attribute.data, "color", 4, np.float32)
        found[attribute.name] = values[vertex_of_loop] if attribute.domain == "POINT" else values
    return found


def _uv_of(layer):
    if hasattr(layer, "uv"):  # Blender 3.5
        return _read(layer.uv, "vector", 2, np.float32)
    return _read(layer.data, "uv", 2, np.float32)


def _read(items, name, size, kind):
    values = np.empty(len(items) * size, kind)
    items.foreach_get(name, values)
    return values.reshape(-1, size) if size > 1 else values


def write_ply(path, geometry, chosen, uv):
    """The chosen triangles, a vertex for each different corner. @param chosen  truth for each triangle
    @param uv  of their corners, (triangles, 3, 2), or None"""
    loops, vertices = geometry.loops[chosen].ravel(), geometry.vertices[chosen].ravel()
    names, columns = ["x", "y", "z"], [geometry.points[vertices]]
    if geometry.normals is not None:
        names += ["nx", "ny", "nz"]
        columns.append(geometry.normals[loops])
    if uv is not None:
        names += ["u", "v"]
        columns.append(uv.reshape(-1, 2))
    corners = np.ascontiguousarray(np.concatenate(columns, 1), np.float32)
    if len(columns) == 1:
        used, index = np.unique(vertices, return_inverse=True)
        rows = geometry.points[used]
    else:
        bytes_of = corners.view(np.dtype((np.void, corners.dtype.itemsize * corners.shape[1]))).ravel()
        _, first, index = np.unique(bytes_of, return_index=True, return_inverse=True)
        rows = corners[first]
    faces = np.empty((len(loops) // 3, 13), np.uint8)
    faces[:, 0] = 3
    faces[:, 1:] = np.ascontiguousarray(index.reshape(-1, 3), "<i4").view(np.uint8)
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}"]
    header += [f"property float {name}" for name in names]
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
    with open(path, "wb") as out:
        out.write("\n".join(header).encode())
        out.write(np.ascontiguousarray(rows, "<f4").tobytes())
        out.write(faces.tobytes())
