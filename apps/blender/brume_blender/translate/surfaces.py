"""Objects with faces: their meshes, materials, roles, and fog inside of them."""

import numpy as np

from .fog import fog_tables
from .light_groups import group_of
from .materials import surface_of
from .meshes import Geometry, write_ply
from .notes import LeftOut
from .surface_points import Surface
from .textures import Textures
from .toml_text import Table
from .volumes import volume_shader_of


NAMES = {"albedo": "base colour", "alpha": "alpha", "radiance": "light"}


def is_held_out(thing, view_layer):
    """Whether an object, or a collection of its, is a holdout."""
    return thing.is_holdout or thing.original.holdout_get(view_layer=view_layer)


def mark_of(thing, view_layer, named):
    """What one volume's places have in common beside their shader: a holdout is no place of one that is seen, nor are things of
    other names where there are mattes, nor of other light groups."""
    return is_held_out(thing, view_layer), thing.name if named else "", group_of(thing)


class Surfaces:
    """Writes each mesh once, however many instances it has."""

    def __init__(self, folder, notes, view_layer, bake, painter, instances, named=False):
        """@param painter  of textures: painting.AtOnce or Beside   @param named  tables have the names of objects and materials, for mattes"""
        self._named = named
        self._bake = bake  # baking.bake, of a shader and its source
        self._instances = instances  # instances.Instances, for fog
        self._folder, self._notes, self._view_layer = folder, notes, view_layer
        self._textures = Textures(folder, painter, notes)
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
                tables += self._fog(thing, fog, (key, materials), geometry, place, matrices)
            except LeftOut as reason:
                self._notes.say(thing.name, f"its fog is left out: {reason}")
        slots = np.minimum(geometry.materials, max(len(materials) - 1, 0))
        for slot in np.unique(slots):
            material = materials[slot] if materials else None
            tables += self._surface(thing, key, geometry, (int(slot), len(materials), slots == slot), material, place, matrices)
        return tables

    def _fog(self, thing, shader, mesh, geometry, place, matrices):
        """@throws LeftOut"""

        def made():
            return fog_tables(thing, shader, geometry, place, self._bake, matrices, self._notes), not place.told

        if matrices[1] is not None:
            return made()[0]
        key, materials = mesh
        mark = mark_of(thing, self._view_layer, self._named)
        return self._instances.tables((key, mark, place.alone, *(m and m.name_full for m in materials)), matrices[0], 1.0, made)

    def _surface(self, thing, key, geometry, part, material, place, matrices):
        """@param part  the material's slot, of how many, and which triangles are of it"""
        surface = self._surface_of(material)
        if surface.invisible:
            if material is not None and volume_shader_of([material]) is None:
                self._notes.say(thing.name, "is transparent, which is left out as if it were not there")
            return []
        name = material.name if material is not None else ""
        where = Surface(geometry, part[2], (key, part[0]), place, self._folder.pictures, self._notes, name)
        looks = self._looks_of(thing, where, surface, material, geometry)
        path = self._mesh(thing, key, geometry, part, next((look.texture for look in looks.values() if look.texture), None))
        table = Table("[[surfaces]]").set(file=self._folder.named(path), object_to_world=matrices[0])
        if matrices[1] is not None:
            if surface.radiance.any():
                self._notes.say(thing.name, "the light that it emits stands still")
            else:
                table.set(object_to_world_end=matrices[1])
        if surface.bsdf is not None:
            _set_material(table, surface, looks["albedo"].colour)
            if surface.bsdf.through is not None:
                self._set_translucence(table, surface, looks["albedo"].colour, material.name, where)
            if looks["alpha"].colour[0] < 1 - 1e-6:
                table.set(alpha=float(looks["alpha"].colour[0]))
            if surface.radiance.any():
                table.set(radiance=looks["radiance"].colour, two_sided=not geometry.closed)
            for key, look in looks.items():
                if look.texture is not None and look.texture.path is not None:
                    table.set(**{key + "_texture": self._folder.named(look.texture.path)})
        self._set_role(table, thing, surface)
        if self._named:
            table.set(name=thing.name)
            if material is not None:
                table.set(material_name=material.name)
        return [table]

    def _surface_of(self, material):
        key = material.name_full if material is not None else None
        if key not in self._surfaces:
            self._surfaces[key] = surface_of(material, self._folder.pictures, self._notes)
        return self._surfaces[key]

    def _looks_of(self, thing, where, surface, material, geometry):
        """A Look by albedo, alpha and radiance; none where there is nothing to see."""
        if surface.bsdf is None:
            return {}
        name = material.name if material is not None else ""
        looks = {
            "albedo": Look(surface.bsdf.colour, surface.bsdf.gain),
            "alpha": Look(surface.alpha or [1.0]),
            "radiance": Look(surface.glow or surface.radiance, is_light=True),
        }
        for look in looks.values():
            look.find(self._textures.of, name, where)
        if len({look.texture.placement() for look in looks.values() if look.texture is not None}) > 1:
            for look in looks.values():  # a mesh has one map
                if look.texture is not None:
                    look.find(self._textures.baked, name, where)
        for key, look in looks.items():
            if look.texture is not None and look.texture.atlas is None and geometry.uv(look.texture.uv_map) is None:
                self._notes.say(thing.name, f"has no UV map for the image on its {NAMES[key]}; it is left out")
                look.texture = None
        return looks

    def _set_translucence(self, table, surface, colour, name, where):
        """Shares the colour out between the two sides."""
        passed, all_of_it = (self._textures.probed(what, name, where) for what in (surface.bsdf.through, surface.bsdf.colour))
        share = np.clip(passed.mean(0) / np.maximum(all_of_it.mean(0), 1e-9), 0, 1)
        if np.abs(passed - share * all_of_it).max() > 0.02 * max(all_of_it.max(), 1e-9):
            self._notes.say(name, "the material lets light of another pattern through than it reflects; the mean of both is taken")
        colour = (1 - 1e-8) * colour  # both as text are no more than 1 together
        table.set(albedo=(1 - share) * colour, translucence=share * colour)

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
        if is_held_out(thing, self._view_layer) or surface.holdout:
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


class Look:
    """A number or colour of a surface. @param what  three numbers, one, or a plug, Blend or Rest
    @param gain  on it   @param is_light  whether it may exceed 1"""

    def __init__(self, what, gain=1.0, is_light=False):
        self._what, self._gain, self._is_light = what, gain, is_light
        self.colour, self.texture = what, None  # a picture multiplies the colour

    def find(self, of, name, where):
        """@param of  Textures.of or baked   @param where  surface_points.Surface"""
        if not isinstance(self._what, (list, np.ndarray)):
            self.colour, self.texture = of(self._what, self._gain, name, where, self._is_light)


def _set_material(table, surface, colour):
    bsdf = surface.bsdf
    table.set(material=bsdf.material, albedo=colour)
    if bsdf.material != "diffuse":
        table.set(roughness=min(max(bsdf.roughness, 0), 1))
    if bsdf.material in ("dielectric", "coated"):
        table.set(ior=min(max(bsdf.ior, 1.0001), 4))
    if bsdf.tint is not None:
        table.set(reflection_tint=bsdf.tint)
    if bsdf.material in ("conductor", "dielectric") and not bsdf.fresnel:
        table.set(**{"edge_albedo" if bsdf.material == "conductor" else "reflection_tint": colour})
