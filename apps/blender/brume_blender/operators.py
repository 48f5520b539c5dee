"""Clean a Cycles animation, from Blender's menus and panels and from scripts."""

import bpy
from bpy.props import IntProperty, StringProperty

from . import program, sequence_cleaning
from .child import CannotStart
from .properties import preferred_program

LOOK = 0.1  # seconds between two steps


class BRUME_OT_clean_animation(bpy.types.Operator):
    """Clean the noise of an animation that Cycles has rendered as OpenEXR MultiLayer: guides of the volumes as they are in
    this file, then a filter that looks through time. Every channel comes back; Esc leaves all files as they are"""

    bl_idname = "brume.clean_animation"
    bl_label = "Clean a Cycles Animation"

    # Of the scene's settings unless given.
    filepath: StringProperty(name="Frames", description="Files of the frames, with #### for the number")
    suffix: StringProperty(name="Suffix", description="Put before the number in the clean files' names; empty: they replace the noisy ones")
    filter: StringProperty(name="Filter", description="NAME or NAME:parameter=value,...; empty: the best for the files")
    start: IntProperty(name="Start", description="First frame")
    end: IntProperty(name="End", description="Last frame")

    def execute(self, context):
        """In one go, as scripts call it."""
        self._begin(context)
        result = {"RUNNING_MODAL"}
        while result == {"RUNNING_MODAL"}:
            result = self._step()
        return result

    def invoke(self, context, event):
        """Step by step, as long as Blender stays open and nobody presses Esc."""
        self._begin(context)
        self._timer = context.window_manager.event_timer_add(LOOK, window=context.window)
        context.window_manager.progress_begin(0, 1)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        if event.type == "ESC":
            self._steps.close()
            self.report({"INFO"}, "cancelled; the files are as they were")
            return self._leave(context, {"CANCELLED"})
        if event.type != "TIMER":
            return {"RUNNING_MODAL"}
        result = self._step()
        if result != {"RUNNING_MODAL"}:
            return self._leave(context, result)
        context.window_manager.progress_update(self._share)
        context.workspace.status_text_set(f"brume: {self._what}, {100 * self._share:.0f} %; Esc cancels")
        return result

    def cancel(self, context):
        """Blender closes."""
        self._steps.close()
        self._leave(context, {"CANCELLED"})

    def _leave(self, context, result):
        context.window_manager.event_timer_remove(self._timer)
        context.window_manager.progress_end()
        context.workspace.status_text_set(None)
        return result

    def _begin(self, context):
        scene = context.scene
        own, render = scene.brume, scene.render

        def given(name, otherwise):
            return getattr(self, name) if self.properties.is_property_set(name) else otherwise

        first, last = given("start", scene.frame_start), given("end", scene.frame_end)
        self._options = sequence_cleaning.Options(
            sequence_cleaning.pattern_of(given("filepath", own.animation_files) or render.filepath),
            list(range(first, last + 1, scene.frame_step)),
            given("suffix", own.animation_suffix),
            given("filter", ""),
            preferred_program(context),
            render.threads if render.threads_mode == "FIXED" else 0,
        )
        self._steps = sequence_cleaning.clean(scene, context.view_layer, self._options)

    def _step(self):
        try:
            self._share, self._what = next(self._steps)
            return {"RUNNING_MODAL"}
        except StopIteration:
            for note in self._options.notes:
                self.report({"WARNING"}, note)
            self.report({"INFO"}, f"{len(self._options.frames)} frames are clean")
            return {"FINISHED"}
        except (sequence_cleaning.Problem, program.NoProgram, CannotStart) as problem:
            self.report({"ERROR"}, str(problem))
            return {"CANCELLED"}


def draw_menu(self, _context):
    self.layout.separator()
    self.layout.operator(BRUME_OT_clean_animation.bl_idname)


def register():
    bpy.utils.register_class(BRUME_OT_clean_animation)
    bpy.types.TOPBAR_MT_render.append(draw_menu)


def unregister():
    bpy.types.TOPBAR_MT_render.remove(draw_menu)
    bpy.utils.unregister_class(BRUME_OT_clean_animation)
