"""Objects with faces: their meshes, materials, roles, and fog inside of them."""

import numpy as np

from .fog import fog_tables
from .materials import surface_of
from .meshes import Geometry, write_ply
from .notes import LeftOut
from .surface_points import Surface
from .textures import Textures
from .toml_text import Table
from .volumes import volume_shader_of


class Surfaces:
    """Writes each mesh once, however many instances it has."""

    def __init__(self, folder, notes, view_layer, bake, named=False):
        """@param named  tables have the names of objects and materials, for mattes"""
        self._named = named
        self._bake = bake  # baking.bake, of a shader and its source
        self._folder, self._notes, self._view_layer = folder, notes, view_layer
        self._textures = Textures(folder, notes)
        self._surfaces = {}
        self.any_catcher = False

    def geometry(self, thing, owner):
        """Of an evaluated object; None: it has no faces. @param owner  that it is an instance of, or itself"""
        key = ("geometry", thing.data.as_pointer() if thing.type == "MESH" else thing.name_full)
        data = thing.data.name_full if thing.data else thing.name_full
        known = self._folder.geometries
        if key not in known or data not in known[key][1]:
            mesh = thing.to_mesh()
            try:
                geometry = Geometry(mesh) if mesh is not None else None
            finally:
                thing.to_mesh_clear()
            known[key] = geometry, {data}
        known[key][1].update((thing.name_full, owner.name_full))
        return key, known[key][0]

    def tables(self, thing, owner, materials, place, matrices):
        """[[surfaces]] of an instance, one for each of its materials that has faces, and [[volumes]] of its fog.
        @param materials  of its slots
        @param matrices  (as the shutter opens, as it closes), the second None where it stands still"""
        key, geometry = self.geometry(thing, owner)
        if geometry is None or len(geometry.loops) == 0:
            return []
        tables = []
        fog = volume_shader_of(materials)
        if fog is not None:
            try:
                tables += fog_tables(thing, fog, geometry, place, self._bake, matrices, self._notes)
            except LeftOut as reason:
                self._notes.say(thing.name, f"its fog is left out: {reason}")
        slots = np.minimum(geometry.materials, max(len(materials) - 1, 0))
        for slot in np.unique(slots):
            material = materials[slot] if materials else None
            tables += self._surface(thing, key, geometry, (int(slot), len(materials), slots == slot), material, place, matrices)
        return tables

    def _surface(self, thing, key, geometry, part, material, place, matrices):
        """@param part  the material's slot, of how many, and which triangles are of it"""
        surface = self._surface_of(material)
        if surface.invisible:
            if material is not None and volume_shader_of([material]) is None:
                self._notes.say(thing.name, "is transparent, which is left out as if it were not there")
            return []
        colour, texture = self._colour_of(thing, (key, part[0]), surface, material, geometry, part[2], place)
        path = self._mesh(thing, key, geometry, part, texture)
        table = Table("[[surfaces]]").set(file=self._folder.named(path), object_to_world=matrices[0])
        if matrices[1] is not None:
            if surface.radiance.any():
                self._notes.say(thing.name, "the light that it emits stands still")
            else:
                table.set(object_to_world_end=matrices[1])
        if surface.bsdf is not None:
            _set_material(table, surface, colour, texture and self._folder.named(texture.path))
            if surface.radiance.any():
                table.set(radiance=surface.radiance, two_sided=not geometry.closed)
        self._set_role(table, thing, surface)
        if self._named:
            table.set(name=thing.name)
            if material is not None:
                table.set(material_name=material.name)
        return [table]

    def _surface_of(self, material):
        key = material.name_full if material is not None else None
        if key not in self._surfaces:
            self._surfaces[key] = surface_of(material, self._notes)
        return self._surfaces[key]

    def _colour_of(self, thing, key, surface, material, geometry, chosen, place):
        """(colour, Texture or None)"""
        if surface.bsdf is None or isinstance(surface.bsdf.colour, list):
            return surface.bsdf and surface.bsdf.colour, None
        where = Surface(geometry, chosen, key, place, self._notes, material.name)
        colour, texture = self._textures.of(surface.bsdf.colour, surface.bsdf.gain, material.name, where)
        if texture is not None and texture.atlas is None and geometry.uv(texture.uv_map) is None:
            self._notes.say(thing.name, "has no UV map for the image on its base colour; it is left out")
            texture = None
        return colour, texture

    def _mesh(self, thing, key, geometry, part, texture):
        slot, slots, chosen = part
        where = (key, slot, slots, texture and texture.placement())
        if where not in self._folder.written:
            uv = None
            if texture is not None and texture.atlas is not None:
                uv = texture.atlas.uv()
            elif texture is not None:
                uv = (geometry.uv(texture.uv_map) @ texture.matrix.T + texture.offset)[geometry.loops[chosen]]
            path = self._folder.new(".ply", thing.data.name if thing.data else thing.name, str(slot))
            write_ply(path, geometry, chosen, uv)
            self._folder.written[where] = path
        return self._folder.written[where]

    def _set_role(self, table, thing, surface):
        original = thing.original
        held = thing.is_holdout or original.holdout_get(view_layer=self._view_layer)
        if held or surface.holdout:
            table.set(role="holdout")
        elif thing.is_shadow_catcher:
            self.any_catcher = True
            self._notes.say(thing.name, "its shadows are in the layers catcher and catcher_unshadowed alone")
            table.set(role="shadow_catcher")
        elif not thing.visible_camera or original.indirect_only_get(view_layer=self._view_layer):
            table.set(visible_to_camera=False)
        kinds = ("diffuse", "glossy", "transmission", "volume_scatter", "shadow")
        unseen = [kind.replace("_", " ") for kind in kinds if not getattr(thing, f"visible_{kind}")]
        if unseen:
            self._notes.say(thing.name, f"is seen by rays of every kind but the camera's in brume, {' and '.join(unseen)} too")


def _set_material(table, surface, colour, picture):
    bsdf = surface.bsdf
    table.set(material=bsdf.material, albedo=colour)
    if picture is not None:
        table.set(albedo_texture=picture)
    if bsdf.material != "diffuse":
        table.set(roughness=min(max(bsdf.roughness, 0), 1))
    if bsdf.material in ("dielectric", "coated"):
        table.set(ior=min(max(bsdf.ior, 1.0001), 4))
    if bsdf.tint is not None:
        table.set(reflection_tint=bsdf.tint)
    if bsdf.material in ("conductor", "dielectric") and not bsdf.fresnel:
        table.set(**{"edge_albedo" if bsdf.material == "conductor" else "reflection_tint": colour})
