"""The picture of `brume view` in Blender's viewports: predicted while something moves, clean at rest.

Each viewport has a program of its own. A changed scene is translated and read again, of its files those that are new; a
changed view is a few numbers over the WebSocket. The program answers when it has something, and a timer that looks for that
runs only until it has come to rest.
"""

import os
import shutil
import tempfile
import weakref

import bpy
import numpy as np

from . import program
from .child import CannotStart
from .light_mix import mix_of
from .live import Live
from .properties import preferred_program
from .region import camera_of, place_of
from .translate import Bakes, CannotTranslate, Folder, View, translate
from .translate.film import exposure_of

LOOK = 0.015  # seconds between two looks for news
PROBLEM_COLOUR = (1.0, 0.45, 0.1, 1.0)  # linear
REACH = 100.0  # at least, from the origin to where a view may be


_viewports_owner = object()  # of what listens to Blender's messages
_viewports = {}  # by their engines' id(): an engine that Blender has ended has no attributes


def viewport_of(engine):
    if id(engine) not in _viewports:
        _viewports[id(engine)] = Viewport(engine)
        _hear_of_light_groups()
    return _viewports[id(engine)]


def _hear_of_light_groups():
    """Blender tells no engine that something is put into another light group. What listens is lost with the file, as are its
    viewports."""
    bpy.msgbus.clear_by_owner(_viewports_owner)
    for key in ((bpy.types.Object, "lightgroup"), (bpy.types.World, "lightgroup"), (bpy.types.Lightgroup, "name")):
        bpy.msgbus.subscribe_rna(key=key, owner=_viewports_owner, args=(), notify=_translate_again)


def _translate_again():
    for viewport in list(_viewports.values()):
        engine = viewport._engine()
        if engine is not None:
            engine.tag_update()
            engine.tag_redraw()


def close_viewport_of(engine):
    viewport = _viewports.pop(id(engine), None)
    if viewport is not None:
        viewport.close()
    if not _viewports:
        bpy.msgbus.clear_by_owner(_viewports_owner)


class Viewport:
    """Of one engine of Blender's, which is one viewport in Rendered shading."""

    def __init__(self, engine):
        self._engine = weakref.ref(engine)
        self._path = tempfile.mkdtemp(prefix="brume_viewport_", dir=bpy.app.tempdir)
        self._folder = Folder(self._path, bakes=os.path.join(bpy.app.tempdir, "grids_baked_for_brume"))
        self._live, self._problem, self._remarks = None, None, []
        self._text, self._revision = None, 0
        self._bakes, self._baking, self._whole = Bakes(), [], False  # whether the scene's text has all that is baked
        self._look, self._number, self._frame, self._exposure = None, 0, None, 1.0
        self._mixing = 0  # the look that asked for another mix of lights last
        self._reach, self._extent = REACH, 0.0  # from the origin: to where the view may be, to what lies farthest from it
        self._shown, self._texture, self._place = None, None, None
        self._waiting = False  # for files that are no longer used, until the program has read the scene without them
        self._timer = self._tick

    def close(self):
        if bpy.app.timers.is_registered(self._timer):
            bpy.app.timers.unregister(self._timer)
        if self._live is not None:
            self._live.close()
            self._live = None
        self._bakes.close()
        shutil.rmtree(self._path, ignore_errors=True)

    def update(self, context, depsgraph):
        """Blender's scene has changed."""
        self._forget(depsgraph)
        self._translate(context, depsgraph)

    def draw(self, context, depsgraph):
        if self._text is None and self._problem is None:
            self._translate(context, depsgraph)
        self._ask(context, depsgraph)
        self._upload()
        self._draw(context, depsgraph.scene)
        self._tell()
        self._write_problem(context)

    # The scene

    def _forget(self, depsgraph):
        """What was read of things that have changed since."""
        changed = {update.id.name_full for update in depsgraph.updates if update.is_updated_geometry}
        self._folder.forget_geometry(changed)
        frame = depsgraph.scene_eval.frame_current_final
        if any(isinstance(update.id, (bpy.types.Image, bpy.types.MovieClip)) for update in depsgraph.updates):
            self._folder.forget_pictures()
        if frame != self._frame:
            self._folder.forget_frame()
        self._frame = frame

    def _translate(self, context, depsgraph):
        self._bakes.begin()
        try:
            view = View(context.space_data, self._reach, self._bakes)
            translation = translate(depsgraph, depsgraph.scene, self._folder, frame=depsgraph.scene.frame_current, view=view)
        except CannotTranslate as reason:
            self._problem = str(reason)
            return
        except Exception as bug:  # which F12 shows in full: a viewport has one line
            self._problem = f"the scene cannot be translated ({type(bug).__name__}: {bug}); F12 says where"
            return
        finally:
            self._baking = self._bakes.settle()
            if self._baking:
                self._look_for_news()
        self._problem = None
        if self._baking and self._whole:
            return  # the last picture stays
        self._whole = not self._baking
        self._remarks, self._extent = translation.notes, translation.reach
        if translation.text == self._text and not (self._live is not None and self._live.ended()):
            return
        part = os.path.join(self._path, "scene.toml.part")
        with open(part, "w", encoding="utf-8") as file:
            file.write(translation.text)
        os.replace(part, self._scene_path())
        self._text, self._revision, self._waiting = translation.text, self._revision + 1, True

    def _scene_path(self):
        return os.path.join(self._path, "scene.toml")

    # The program

    def _ask(self, context, depsgraph):
        """Tells the program what is looked at, where that has changed."""
        if self._text is None:
            return
        look = self._look_of(context, depsgraph)
        if look == self._look:
            return
        mixes = self._look is not None and {**look, "mix": None} == {**self._look, "mix": None}  # and nothing else
        if mixes and self._waits_for_mix():
            return
        if self._live is not None and self._live.ended():
            self._live.close()
            self._live = None
        if self._live is None:
            threads = ["--threads", depsgraph.scene.render.threads] if depsgraph.scene.render.threads_mode == "FIXED" else []
            try:
                self._live = Live(program.find(preferred_program(context)), self._scene_path(), threads)
            except (program.NoProgram, CannotStart) as reason:
                self._problem = str(reason)
                return
        # One that moves would be answered coarsely; a mix is one of what is there.
        self._look, self._number = look, self._live.look(moving=not mixes, frame=None, **look)
        if mixes:
            self._mixing = self._number
        self._look_for_news()

    def _waits_for_mix(self):
        """Whether a mix that was asked for has not been answered: the next one is asked for then."""
        if self._live is None or self._live.rests():
            return False
        picture = self._live.pictures().get("picture")
        return picture is None or picture.about["id"] < self._mixing

    def _look_for_news(self):
        if not bpy.app.timers.is_registered(self._timer):
            bpy.app.timers.register(self._timer, first_interval=LOOK)

    def _look_of(self, context, depsgraph):
        scene, settings = depsgraph.scene_eval, depsgraph.scene_eval.brume
        self._exposure = exposure_of(scene)
        self._place = place_of(context, scene)
        camera, reach = camera_of(context, scene, depsgraph, self._place, self._extent)
        if reach > self._reach:
            while self._reach < reach:
                self._reach *= 2
            self._translate(context, depsgraph)
        assignments = camera.assignments()
        if settings.indirect_limit > 0:
            assignments.append(f"render.indirect_limit={settings.indirect_limit}")
        return {
            "set": assignments,
            "size": _size(self._place, context, scene),
            "layers": ["picture", "alpha"] if scene.render.film_transparent else ["picture"],
            "samples": settings.viewport_samples,
            "revision": self._revision,
            "mix": mix_of(context.view_layer, self._live.light_groups() if self._live is not None else ()),
        }

    def _tick(self):
        """Of a timer: has the viewport drawn when something has come."""
        engine = self._engine()
        if engine is None:
            return None
        try:
            if self._bakes.news():
                engine.tag_update()  # Blender asks for the scene once more
            if self._live is not None and self._live.news():
                engine.tag_redraw()
        except ReferenceError:  # Blender has ended it
            return None
        rests = self._live is None or self._live.rests()
        return None if rests and not self._bakes.busy() else LOOK

    # The picture

    def _upload(self):
        """Makes a texture of the newest picture."""
        import gpu  # not there where Blender has no window

        if self._live is None:
            return
        pictures = self._live.pictures()
        picture = pictures.get("picture")
        if picture is None or picture is self._shown:
            return
        self._shown = picture
        rgba = _rgba(picture.values, pictures.get("alpha") if "alpha" in self._look["layers"] else None)
        rgba[..., :3] *= self._exposure
        buffer = gpu.types.Buffer("FLOAT", rgba.size, rgba.ravel())
        self._texture = gpu.types.GPUTexture((rgba.shape[1], rgba.shape[0]), format="RGBA16F", data=buffer)
        if self._waiting and picture.about["id"] == self._number:
            self._folder.remove_unused(self._text)
            self._waiting = False

    def _draw(self, context, scene):
        import gpu
        from gpu_extras.presets import draw_texture_2d

        engine = self._engine()
        if self._texture is None or engine is None:
            return
        x0, y0, x1, y1 = self._place
        gpu.state.blend_set("ALPHA_PREMULT")
        engine.bind_display_space_shader(scene)
        draw_texture_2d(self._texture, (x0, y0), x1 - x0, y1 - y0)
        engine.unbind_display_space_shader()
        gpu.state.blend_set("NONE")

    def _tell(self):
        problem = self._problem or (self._live.problem() if self._live is not None else None)
        more = f" (and {len(self._remarks) - 1} more; F12 reports all)" if len(self._remarks) > 1 else ""
        remarks = self._remarks[0] + more if self._remarks else ""
        self._engine().update_stats("brume | " + (problem or self._state()), "" if problem else remarks)

    def _write_problem(self, context):
        """Over the picture, where Blender hides its own texts with the overlays."""
        problem = self._problem or (self._live.problem() if self._live is not None else None)
        if not problem or context.space_data.overlay.show_overlays:
            return
        import blf

        scale, font = context.preferences.system.ui_scale, 0
        blf.enable(font, blf.WORD_WRAP | blf.SHADOW)
        blf.word_wrap(font, max(int(context.region.width - 140 * scale), 100))
        blf.shadow(font, 5, 0, 0, 0, 1)
        blf.size(font, 12 * scale, *([72] if bpy.app.version < (4, 0, 0) else []))
        blf.color(font, *PROBLEM_COLOUR)
        blf.position(font, 70 * scale, context.region.height - 60 * scale, 0)
        blf.draw(font, "brume | " + problem)
        blf.disable(font, blf.WORD_WRAP | blf.SHADOW)

    def _state(self):
        if not self._baking:
            return self._picture_state()
        more = f" and {len(self._baking) - 1} more" if len(self._baking) > 1 else ""
        return f"baking {self._baking[0]}{more} ... | {self._picture_state()}"

    def _picture_state(self):
        if self._shown is None:
            return "reading the scene"
        about = self._shown.about
        mix = "" if not (self._look and self._look["mix"]) else " | lights not mixed" if about.get("mixed") is False else " | lights mixed"
        if about["stage"] == "predicted":
            return "predicted" + mix
        error = "" if about["error"] is None else f" | estimated error {100 * about['error']:.2g} %"
        return f"{about['samples']} samples{error}{mix}"


def _size(place, context, scene):
    """Of the picture [px]."""
    setting = scene.render.preview_pixel_size
    pixel = max(int(context.preferences.system.pixel_size), 1) if setting == "AUTO" else int(setting)
    x0, y0, x1, y1 = place
    largest = 4096
    return [min(max((x1 - x0) // pixel, 1), largest), min(max((y1 - y0) // pixel, 1), largest)]


def _rgba(values, alpha):
    """Floats of (height, width, 4), rows from the bottom. @param alpha  Picture, or None: opaque"""
    rgba = np.ones((*values.shape[1:], 4), np.float32)
    rgba[..., :3] = values.transpose(1, 2, 0)
    if alpha is not None and alpha.values.shape[1:] == values.shape[1:]:
        rgba[..., 3] = np.clip(alpha.values.astype(np.float32).sum(0), 0, 1)
    return rgba[::-1].copy()
