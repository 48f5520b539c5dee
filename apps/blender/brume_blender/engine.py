"""The render engine: a scene goes to the program as files, pictures come back while it renders."""

import os
import shutil
import tempfile
import time

import bpy
import numpy as np

from . import exr, passes, program
from .child import DONE, MISSED, CannotStart, Child, Progress, Update
from .properties import lacking_passes, matte_settings, preferred_program, wanted_passes
from .translate import CannotTranslate, translate
from .translate.film import exposure_of
from .viewport import close_viewport_of, viewport_of
from .window import window_of

THIS_FRAME = 1  # its number in the sequence that is given to the program for what moves
LOOK = 0.05  # seconds between two looks at Esc
# What the program remarks in words of scene files, by how it begins, in Blender's; empty: not at all.
IN_BLENDERS_WORDS = {
    "the scene has no [[volumes]]": "",
    "one sample per pixel makes no two halves": "Samples is 1: two or more tell the cleaning how noisy the picture is",
}


class Problem(Exception):
    """Why there is no picture: what Blender's report says."""


class Cancelled(Exception):
    """The user ended the render."""


class Said:
    """What was reported, so that it is said once in a render, however many frames that has."""

    texts = set()


@bpy.app.handlers.persistent  # a file that is opened takes away the others
def forget_what_was_said(*_):
    Said.texts.clear()


class BrumeRenderEngine(bpy.types.RenderEngine):
    bl_idname = "BRUME"
    bl_label = "brume"
    bl_use_preview = False
    bl_use_postprocess = True
    bl_use_shading_nodes_custom = False
    bl_use_eevee_viewport = True

    # Blender calls these.

    def update_render_passes(self, scene=None, renderlayer=None):
        for p in wanted_passes(renderlayer)[0]:
            self.register_pass(scene, renderlayer, self._name(p), len(p.components), p.components, p.kind)

    def render(self, depsgraph):
        began = time.monotonic()
        try:
            with _Frame(self, depsgraph) as frame:
                frame.render()
                self._status(f"{frame.samples_text()} | {time.monotonic() - began:.1f} s")
        except Cancelled:
            self._status("cancelled")
        except (Problem, CannotTranslate, CannotStart, program.NoProgram, exr.NotReadable) as problem:
            self.report({"ERROR"}, str(problem))
            self.error_set(str(problem))

    def view_update(self, context, depsgraph):
        viewport_of(self).update(context, depsgraph)

    def view_draw(self, context, depsgraph):
        viewport_of(self).draw(context, depsgraph)

    def __del__(self):
        close_viewport_of(self)
        getattr(super(), "__del__", lambda: None)()  # Blender 4.4

    def say(self, text):
        """Reports what the user should know of the scene or the picture, once."""
        if text not in Said.texts:
            Said.texts.add(text)
            self.report({"WARNING"}, text)

    def _name(self, p):
        return passes.blender_name(p.name, bpy.app.version)

    def _status(self, text):
        self.update_stats("", "brume | " + text)

    def check_break(self):
        """@throws Cancelled"""
        if self.test_break():
            raise Cancelled


class _Frame:
    """One view layer of one frame on its way, with a folder of its own."""

    def __init__(self, engine, depsgraph):
        self._engine, self._depsgraph = engine, depsgraph
        self._original, self._scene = depsgraph.scene, depsgraph.scene_eval  # whose settings may be animated
        self._layer = self._original.view_layers[depsgraph.view_layer.name]
        self._window = window_of(self._scene.render, engine.resolution_x, engine.resolution_y)
        self._transparent, self._exposure = self._scene.render.film_transparent, exposure_of(self._scene)
        self._passes, unknown = wanted_passes(self._layer)
        if unknown:
            known = ", ".join((*passes.LAYERS, *passes.GIVEN))
            raise Problem(f"View layer {self._layer.name}: brume has no layer '{unknown[0]}'; it has {known}")
        if lacking := lacking_passes(self._layer):
            engine.say(f"View layer {self._layer.name}: brume has no pass {', '.join(lacking)}; there is none in the result")
        if self._scene.render.use_multiview:
            raise Problem("brume renders one eye; switch off Output Properties > Stereoscopy")
        self._result = None
        self._samples, self._error, self._left = None, None, None

    def __enter__(self):
        self._folder = tempfile.mkdtemp(prefix="brume_", dir=bpy.app.tempdir)
        return self

    def __exit__(self, *_):
        self._end_result()
        shutil.rmtree(self._folder, ignore_errors=True)

    def _path(self, name):
        return os.path.join(self._folder, name)

    def render(self):
        """@throws Problem, Cancelled, ..."""
        path = program.find(preferred_program())
        self._engine._status("translating the scene")
        self._translate()
        self._add_passes()
        with Child(path, self._arguments()) as child:
            status = self._listen(child)
            for remark in child.remarks():
                known = [words for begin, words in IN_BLENDERS_WORDS.items() if remark.startswith(begin)]
                if known != [""]:
                    self._engine.say(known[0] if known else remark)
            if status == MISSED:
                self._engine.say(child.problem(status))
            elif status != DONE:
                raise Problem(child.problem(status))
        self._show_all(exr.read(self._path("frame.exr")))

    def _translate(self):
        translation = translate(
            self._depsgraph,
            self._original,
            self._folder,
            frame=self._original.frame_current,
            width=self._window.film_width,
            height=self._window.film_height,
            set_frame=self._engine.frame_set,
            bakes=os.path.join(bpy.app.tempdir, "grids_baked_for_brume"),
            check=self._engine.check_break,
            steps=self._layer.use_pass_vector,
        )
        for note in translation.notes:
            self._engine.say(note)
        if translation.holdouts and not self._transparent:
            names = ", ".join(translation.holdouts)
            self._engine.say(f"{names}: leaves a hole in the picture, but none in its alpha unless Film > Transparent is on")
        texts = {"scene": translation.text}
        if translation.beside:
            before, after = translation.beside
            texts = {f"scene.{THIS_FRAME - 1}": before, f"scene.{THIS_FRAME}": translation.text, f"scene.{THIS_FRAME + 1}": after}
        for name, text in texts.items():
            with open(self._path(name + ".toml"), "w", encoding="utf-8") as file:
                file.write(text)

    def _arguments(self):
        settings, render = self._scene.brume, self._scene.render
        extra = [p.name for p in self._passes if p.name not in passes.KNOWN]
        words = ["render", *self._scene_words(), "-o", self._path("frame.exr"), "--updates", self._path("update.exr")]
        words += ["--layers", ",".join(passes.layers_for(self._passes, extra, self._transparent)), "--seed", settings.seed]
        if settings.use_clean:
            words += ["--clean", "--clean-filter", settings.filter]
        if settings.ends_by_samples():
            words += ["--spp", settings.samples]
        if settings.use_time:
            words += ["--time", f"{settings.time:.6f}s"]
        if settings.use_error:
            words += ["--target-error", settings.error]
        if not self._window.is_whole():
            words += ["--crop", self._window.crop()]
        if render.threads_mode == "FIXED":
            words += ["--threads", render.threads]
        if self._transparent:
            words += ["-D", "environment.visible_to_camera=false"]
        if settings.indirect_limit > 0:
            words += ["-D", f"render.indirect_limit={settings.indirect_limit}"]
        objects, materials, levels = matte_settings(self._layer)
        if objects or materials:
            words += ["-D", f"render.cryptomatte_levels={levels}"]
        if settings.use_fixed_seed:
            words += ["-D", "render.noise_frame=0"]
        return words

    def _scene_words(self):
        """The scene, or a sequence of those of the frames beside it, of which this one is rendered."""
        if not self._layer.use_pass_vector:
            return [self._path("scene.toml")]
        noise = [] if self._scene.brume.use_fixed_seed else ["-D", f"render.noise_frame={max(self._original.frame_current, 0)}"]
        return [self._path("scene.#.toml"), "--frames", THIS_FRAME, *noise]

    def _listen(self, child):
        """Until the program has ended. @return its exit status"""
        while not child.ended():
            self._take(child.events(LOOK))
            if self._engine.test_break():
                child.interrupt()
                raise Cancelled
        status, rest = child.finish()
        self._take(rest)
        return status

    def _take(self, events):
        for event in events:
            if isinstance(event, Progress):
                self._left = event.seconds_left
                if event.stage.startswith("render"):
                    self._engine.update_progress(min(max(event.fraction, 0.0), 1.0))
            elif isinstance(event, Update):
                self._samples, self._error = event.samples, event.error
                if not event.last:  # which is shown with all its passes
                    self._show_picture(exr.read(event.picture))
        if events:
            left = "" if not self._left else f" | {_duration(self._left)} left"
            self._engine._status(self.samples_text() + left)

    def samples_text(self):
        if self._samples is None:
            return "preparing"
        error = "" if self._error is None else f" | estimated error {100 * self._error:.2g} %"
        return f"{self._samples:.4g} samples{error}"

    # Blender's pictures

    def _add_passes(self):
        for p in self._passes[1:]:
            name = self._engine._name(p)
            self._engine.add_pass(name, len(p.components), p.components, layer=self._layer.name)
        self._result = self._engine.begin_result(0, 0, self._window.width, self._window.height, layer=self._layer.name)
        self._blender_passes = {p.name: p for p in self._result.layers[0].passes}

    def _fill(self, name, values):
        """@param values  rows from the top; Blender's go from the bottom"""
        rows = np.ascontiguousarray(values[::-1], np.float32).reshape(-1, values.shape[-1])
        rect = self._blender_passes[name].rect
        try:
            rect.foreach_set(rows)  # Blender 3.4 wants a row for each pixel
        except TypeError:
            rect.foreach_set(rows.ravel())

    def _show_picture(self, frame):
        self._fill("Combined", passes.picture(frame, self._transparent, self._exposure))
        self._engine.update_result(self._result)

    def _show_all(self, frame):
        made = passes.Passes(frame, self._transparent, self._exposure)
        for p in self._passes:
            self._fill(self._engine._name(p), made.values(p))
        whole = self._engine.get_result()  # of all view layers, which is written into files
        for key, value in passes.matte_metadata(frame.header, self._layer.name).items():
            whole.stamp_data_add_field(key, value)
        self._engine.update_result(self._result)

    def _end_result(self):
        if self._result is not None:
            self._engine.end_result(self._result)
            self._result = None


def _duration(seconds):
    minutes, seconds = divmod(int(seconds + 0.5), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{seconds:02}" if hours else f"{minutes}:{seconds:02}"


def register():
    bpy.utils.register_class(BrumeRenderEngine)
    bpy.app.handlers.render_init.append(forget_what_was_said)


def unregister():
    bpy.app.handlers.render_init.remove(forget_what_was_said)
    bpy.utils.unregister_class(BrumeRenderEngine)
