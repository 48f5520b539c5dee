"""A Blender scene as a brume scene.

`translate` reads an evaluated scene and writes what brume renders: the text of a scene file, and the meshes and pictures
that it names. What has no counterpart is left out, or what comes nearest taken, and said, a line for each kind with the
things that it is about.

Knows bpy, mathutils and NumPy alone.
"""

import math
from dataclasses import dataclass, field

import bpy
import numpy as np
from mathutils import Vector

from .baking import MILLIONS, VIEWPORT_MILLIONS, bake
from .beside import Bakes
from .camera import camera_of, camera_table, say_clipped
from .files import Folder
from .film import film_size, film_table, pixel_aspect_of
from .fog import world_fog_table
from .fluids import domain_of, domain_tables
from .instances import Instances
from .light_groups import group_names, group_of, put_in_group
from .lights import light_table
from .meshes import MESH_LIKE
from .motion import key_of, motion_of
from .notes import CannotTranslate, LeftOut, Notes
from .placement import matrices_of
from .painting import AtOnce, Beside
from .places import Place
from .steps import mist_keys, steps_of
from .surfaces import Surfaces, is_held_out, mark_of
from .toml_text import Table, toml_text
from .volumes import factor_of, file_of, volume_shader_of, volume_tables
from .world import world_of, world_tables

__all__ = ["Bakes", "CannotTranslate", "Folder", "Translation", "View", "translate"]

# What is never seen: cameras, helpers.
UNSEEN = ("CAMERA", "EMPTY", "ARMATURE", "LATTICE", "LIGHT_PROBE", "SPEAKER")

LACKING = {"GPENCIL": "grease pencil", "GREASEPENCIL": "grease pencil", "CURVES": "hair curves", "POINTCLOUD": "point clouds"}


@dataclass
class Translation:
    text: str  # of the scene file, whose names start at the folder
    notes: list = field(default_factory=list)  # lines: what was left out or replaced
    files: list = field(default_factory=list)  # paths written into the folder
    shadow_catcher: bool = False  # whether the layers catcher and catcher_unshadowed show something
    volumes: int = 0  # how many there are to render
    reach: float = 0.0  # from the origin to what lies farthest from it
    beside: list = field(default_factory=list)  # texts of the scene a frame before, and a frame after
    holdouts: list = field(default_factory=list)  # names


@dataclass
class View:
    """A viewport, which says from moment to moment what is looked at: the scene has no camera of its own, and nothing is blurred by
    motion."""

    space: object  # its SpaceView3D, which decides what is shown
    reach: float  # from the origin to where it may look from
    bakes: Bakes  # that run beside it


def translate(
    depsgraph, scene, folder, *, frame=None, width=None, height=None, set_frame=None, scene_folder=None, bakes=None, view=None,
    check=lambda: None, steps=False,
):  # fmt: skip
    """Writes the meshes and pictures of a scene into a folder and returns the scene's text.

    @param depsgraph  evaluated, of a render or the viewport, at `frame`
    @param scene      the original; its animated settings are read from the depsgraph's
    @param frame      the scene's own unless given
    @param width, height  of the film [px]; the scene's own unless given
    @param set_frame  function of (frame, subframe) that evaluates the depsgraph at another time, as RenderEngine.frame_set
                      and Scene.frame_set do: for motion blur, which is left out without it
    @param scene_folder  where the scene file is to lie, at which its names of files start; `folder` unless given
    @param bakes  folder in which baked grids are kept for later renders; `folder` unless given
    @param view   View, of a viewport; `folder` is a Folder then, that stays the same from one translation to the next
    @param check  called now and then; may throw, to end it
    @param steps  whether the frames beside this one are wanted, too, for what moves (Translation.beside); takes set_frame
    @throws CannotTranslate: there is no camera, or one of which brume has no counterpart; a volume's file is not there
    """
    files = folder if view is not None else Folder(folder, scene_folder, bakes)
    try:
        return _Translator(depsgraph, scene, files, frame, (width, height), set_frame, view, check, steps).run()
    except CannotTranslate:
        if view is None:
            files.remove()
        raise


class _Translator:
    def __init__(self, depsgraph, scene, folder, frame, size, set_frame, view, check, steps):
        self._depsgraph, self._original, self._folder = depsgraph, scene, folder
        self._frame = scene.frame_current if frame is None else frame
        stretch = scene.render.frame_map_old / scene.render.frame_map_new
        self._frame_of_files = math.floor(self._frame * stretch)  # Time Stretching
        own = film_size(self._scene)
        self._width, self._height = size[0] or own[0], size[1] or own[1]
        self._notes = Notes()
        self._set_frame, self._view, self._check = set_frame, view, check
        self._wants_steps = steps
        self._shown = "show_render" if depsgraph.mode == "RENDER" else "show_viewport"  # switch of modifiers
        self._reach = 0.0  # from the origin to what lies farthest from it
        self._holdouts = set()  # their names
        self._trees = {}  # of shaders that have been read
        self._instances, self._corners = Instances(), {}  # corners: of volumes' boxes, by what they are of

    @property
    def _scene(self):
        """Evaluated, at the time at which the depsgraph is."""
        return self._depsgraph.scene_eval

    def run(self):
        aspect = pixel_aspect_of(self._scene)
        size = (self._width, self._height, aspect)
        self._motion = self._steps = None
        if self._view is None:
            camera = camera_of(self._depsgraph, self._scene)
            self._motion = motion_of(self._depsgraph, self._scene, camera, self._frame, self._set_frame, size, self._notes)
            if self._wants_steps:
                camera = camera_of(self._depsgraph, self._scene)
                self._steps = steps_of(self._depsgraph, camera, self._frame, self._set_frame, size, self._notes)
        self._layer = self._view_layer()
        self._named = self._view is None and (self._layer.use_pass_cryptomatte_object or self._layer.use_pass_cryptomatte_material)
        wants_groups = self._view is None or self._layer.brume.use_mix
        self._groups = group_names(self._layer) if wants_groups else {}
        self._painter = AtOnce(self._folder, self._check) if self._view is None else Beside(self._folder, self._view.bakes)
        self._surfaces = Surfaces(self._folder, self._notes, self._layer, self._bake, self._painter, self._instances, self._named)
        self._camera = camera_of(self._depsgraph, self._scene) if self._view is None else None
        head = [
            Table("[render]").set(frame=max(self._frame, 0), **(mist_keys(self._scene.world) if self._layer.use_pass_mist else {})),
            self._camera_table(size),
            film_table(self._scene, self._width, self._height),
        ]
        tables, far = self._objects(), self._world()
        if (fog := self._world_fog()) is not None:
            # Nothing from infinitely far away comes through it.
            far = [Table("[environment]"), fog]
            tables = [table for table in tables if not table.holds(type="sun")]
        tables = head + far + tables
        tables = self._instances.placed(tables, self._folder)
        beside = self._steps.tables(tables) if self._steps is not None else []
        return Translation(
            self._text(tables),
            self._notes.lines(),
            self._folder.files,
            self._surfaces.any_catcher,
            sum(table.header == "[[volumes]]" for table in tables),
            self._reach,
            [self._text(other) for other in beside],
            sorted(self._holdouts),
        )

    def _text(self, tables):
        return "\n".join(["\n".join(self._comment()), f"name = {toml_text(self._scene.name)}\n", *(t.text() for t in tables)])

    def _camera_table(self, size):
        if self._view is not None:
            return Table("[camera]").set(position=[0, 0, 0], look_at=[0, 0, -1], fov=40)
        return camera_table(self._depsgraph, self._camera, self._motion, *size, self._notes)

    def _world(self):
        try:
            tables = world_tables(self._depsgraph, self._scene, self._layer, self._folder, self._painter, self._notes)
            put_in_group(tables, self._groups.get(group_of(self._scene.world)) if self._scene.world is not None else None)
            return tables
        except LeftOut as reason:
            self._notes.say(self._scene.world.name, f"the world is left out: {reason}")
            return [Table("[environment]")]

    def _world_fog(self):
        world = world_of(self._depsgraph, self._scene, self._layer)
        reach = max(self._reach, self._view.reach if self._camera is None else self._camera.matrix_world.translation.length)
        try:
            return world_fog_table(world, self._depsgraph, reach, self._notes)
        except LeftOut as reason:
            self._notes.say(world.name, f"its volume is left out: {reason}")
            return None

    def _view_layer(self):
        layer = self._depsgraph.view_layer
        return self._original.view_layers.get(layer.name, layer)

    def _comment(self):
        source = " ".join(bpy.path.basename(bpy.data.filepath).split()) or "A scene"
        lines = [f"# {source} of Blender {bpy.app.version_string}, frame {self._frame}."]
        return lines + ["# Left out: " + note.replace("\n", " ") for note in self._notes.lines()]

    def _objects(self):
        tables = []
        for instance in self._depsgraph.object_instances:
            self._check()
            thing = instance.object
            if not instance.show_self or not self._is_shown(instance, thing):
                continue
            try:
                tables += self._object(instance, thing)
            except LeftOut as reason:
                what = {"VOLUME": "the volume is left out: ", "LIGHT": "the light is left out: "}.get(thing.type, "is left out: ")
                self._notes.say(thing.name, what + str(reason))
        return tables

    def _is_shown(self, instance, thing):
        if self._view is None:
            owner = instance.parent if instance.is_instance else None
            if owner is None:
                return not thing.hide_render
            # What a collection hides has no instances; what geometry nodes, vertices and particles show may itself be hidden.
            return not (owner.hide_render or (owner.instance_type == "COLLECTION" and thing.hide_render))
        return (instance.parent if instance.is_instance and instance.parent else thing).visible_in_viewport_get(self._view.space)

    def _materials(self, thing):
        override = self._layer.material_override
        return [override.evaluated_get(self._depsgraph)] if override is not None else [slot.material for slot in thing.material_slots]

    def _object(self, instance, thing):
        kind = thing.type
        if not (self._layer.use_volumes if kind == "VOLUME" else self._layer.use_solid or kind not in MESH_LIKE):
            return []
        if kind == "LIGHT":
            if self._motion is not None and self._motion.matrices(instance):
                self._notes.say(thing.name, "the light stands still while the shutter is open")
            tables = [light_table(instance, self._notes)]
            put_in_group(tables, self._groups.get(group_of(thing)))
            return tables
        if kind == "VOLUME" or kind in MESH_LIKE:
            tables = self._marked(self._placed(instance, thing), thing)
            put_in_group(tables, self._groups.get(group_of(thing)))
            if any(table.holds(role="holdout") for table in tables):
                self._holdouts.add(thing.name)
            if self._steps is not None:
                self._steps.own(tables, instance)
            return tables
        if kind not in UNSEEN:
            self._notes.say(thing.name, f"is left out: brume has no {LACKING.get(kind, kind.lower().replace('_', ' '))}")
        return []

    def _marked(self, tables, thing):
        """Gives volumes the role of their object and, where there are mattes, its name; surfaces have them."""
        volumes = [table for table in tables if table.header == "[[volumes]]"]
        if volumes and is_held_out(thing, self._layer):
            for table in volumes:
                table.set(role="holdout")
        if volumes and self._named:
            shaders = [m for m in self._materials(thing) if m is not None and volume_shader_of([m]) is not None]
            for table in volumes:
                table.set(name=thing.name)
                if shaders:
                    table.set(material_name=shaders[0].name)
        return tables

    def _placed(self, instance, thing):
        """Of a volume, or of an object with faces."""
        matrices = matrices_of(instance, self._motion, self._notes)
        if matrices is None:
            return []
        if self._motion is not None and self._motion.deforms(thing):
            self._notes.say(thing.name, "its deformation is left out of the motion blur")
        if thing.type == "VOLUME":
            self._say_visibility(thing)
            return self._volume(instance, thing, matrices)
        self._say_particles(thing)
        self._say_clipped(thing, thing.bound_box, instance.matrix_world)
        domain = domain_of(thing, self._shown)
        if domain is not None or volume_shader_of(self._materials(thing)) is not None:
            self._say_visibility(thing)
        if domain is not None:
            return domain_tables(
                thing, self._materials(thing), domain, self._frame_of_files, self._place(instance, thing.bound_box), self._bake,
                matrices, self._shutter(), self._scene, self._notes,
            )  # fmt: skip
        owner = instance.parent if instance.is_instance and instance.parent else thing
        return self._surfaces.tables(thing, owner, self._materials(thing), self._place(instance, thing.bound_box), matrices)

    def _volume(self, instance, thing, matrices):
        materials, factor = self._materials(thing), factor_of(thing.data, instance.matrix_world)
        mark = mark_of(thing, self._layer, self._named)
        key = (thing.data.as_pointer(), mark, self._alone(instance), *(material and material.name_full for material in materials))

        def made():
            file = file_of(thing, factor, self._shutter(), self._scene, self._frame_of_files, self._folder, self._shown)
            self._corners[key] = file.corners
            place = self._place(instance)
            tables = volume_tables(thing, materials, file, place, self._bake, matrices, self._notes)
            return tables, not place.told

        if matrices[1] is not None:
            tables, _ = made()
        else:
            tables = self._instances.tables(key, matrices[0], factor, made)
        if self._corners[key]:
            self._say_clipped(thing, self._corners[key], instance.matrix_world)
        return tables

    def _say_clipped(self, thing, corners, matrix):
        self._reach = max([self._reach, *((matrix @ Vector(corner)).length for corner in corners)])
        if self._camera is not None:
            say_clipped(self._camera, thing.name, corners, matrix, self._notes)

    def _place(self, instance, box=None):
        """@param box  corners of the object's texture space; None: there is none"""
        corners = np.array([corner[:] for corner in box]) if box is not None else None
        box = None if corners is None else (corners.min(0), corners.max(0))
        return Place(
            instance.object, instance.matrix_world, self._depsgraph, box, instance.random_id, self._alone(instance), self._trees,
            instance.parent if instance.is_instance else None,
        )  # fmt: skip

    def _alone(self, instance):
        """What tells an instance that moves from frame to frame from others, none of which it can be a place of; None: it stands still."""
        return key_of(instance) if self._steps is not None and self._steps.moves(instance) else None

    def _shutter(self):
        """[open, close] over which velocities are asked for [frames]; None: they are not."""
        return self._motion.shutter if self._motion is not None else (0.0, 1.0) if self._steps is not None else None

    def _bake(self, shader, source):
        settings = getattr(self._scene, "brume", None)
        millions = settings.bake_millions if settings else MILLIONS
        if self._view is not None:
            return self._view.bakes.bake(shader, source, self._folder, 1e6 * min(millions, VIEWPORT_MILLIONS), self._notes)
        return bake(shader, source, self._folder, 1e6 * millions, self._notes, self._check)

    def _say_visibility(self, thing):
        """Of a volume, or of the fog in a mesh."""
        kinds = ("camera", "diffuse", "glossy", "transmission", "shadow")
        unseen = [kind for kind in kinds if not getattr(thing, "visible_" + kind)]
        if thing.original.indirect_only_get(view_layer=self._layer) and "camera" not in unseen:
            unseen.insert(0, "camera")
        if unseen:
            self._notes.say(thing.name, f"its volume is seen by rays of every kind in brume, {' and '.join(unseen)} too")

    def _say_particles(self, thing):
        if any(system.settings.type == "HAIR" and system.settings.render_type == "PATH" for system in thing.particle_systems):
            self._notes.say(thing.name, "its hair is left out")
