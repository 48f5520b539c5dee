"""Panels of brume, and Blender's own that make sense with it."""

import importlib

import bpy

from .operators import BRUME_OT_clean_animation
from .presets import PRESETS, BRUME_OT_preset
from .translate.meshes import MESH_LIKE

ENGINE = "BRUME"

# Panels that Blender draws for its own engines: shaders of materials, lights and worlds, as Eevee has them without settings
# of Eevee's own.
SHADERS = {
    "EEVEE_MATERIAL_PT_context_material",
    "EEVEE_MATERIAL_PT_surface",
    "EEVEE_MATERIAL_PT_volume",
    "EEVEE_WORLD_PT_surface",
    "EEVEE_WORLD_PT_volume",
    "WORLD_PT_context_world",
    "DATA_PT_spot",
    "DATA_PT_camera_dof",
    "DATA_PT_camera_dof_aperture",
}
# Of those that every engine is offered, what brume has no use for.
USELESS = {
    "RENDER_PT_gpencil",
    "RENDER_PT_simplify_greasepencil",
    "RENDER_PT_freestyle",
    "VIEWLAYER_PT_freestyle",
    "VIEWLAYER_PT_freestyle_edge_detection",
    "VIEWLAYER_PT_freestyle_linestyle",
    "VIEWLAYER_PT_freestyle_lineset",
    "MATERIAL_PT_freestyle_line",
    "RENDER_PT_stereoscopy",
    "DATA_PT_light",
    "DATA_PT_area",
}


def _takes(panel):
    """Whether one of Blender's panels is shown for brume."""
    engines = getattr(panel, "COMPAT_ENGINES", None)
    if engines is None or panel.__module__.startswith(__package__):
        return False
    return panel.__name__ in SHADERS or ("BLENDER_RENDER" in engines and panel.__name__ not in USELESS)


class _BrumePanel:
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"

    @classmethod
    def poll(cls, context):
        return context.engine == ENGINE


class BRUME_RENDER_PT_sampling(_BrumePanel, bpy.types.Panel):
    bl_label = "Sampling"
    bl_context = "render"
    bl_order = -5

    def draw(self, context):
        layout, settings = self.layout, context.scene.brume
        row = layout.row(align=True)
        for key, (name, _, _) in PRESETS.items():
            row.operator(BRUME_OT_preset.bl_idname, text=name).preset = key
        layout.use_property_split = True
        layout.use_property_decorate = False
        row = layout.row()
        row.active = settings.ends_by_samples()
        row.prop(settings, "samples")
        for switch, value, heading in (("use_error", "error", "Target Error"), ("use_time", "time", "Time Limit")):
            row = layout.row(heading=heading)
            row.prop(settings, switch, text="")
            sub = row.row()
            sub.active = getattr(settings, switch)
            sub.prop(settings, value, text="")
        layout.prop(settings, "viewport_samples")
        row = layout.row(align=True)
        row.prop(settings, "seed")
        row.prop(settings, "use_fixed_seed", toggle=True)
        layout.prop(settings, "indirect_limit")


class BRUME_RENDER_PT_clean(_BrumePanel, bpy.types.Panel):
    bl_label = "Clean"
    bl_context = "render"
    bl_order = -4

    def draw_header(self, context):
        self.layout.prop(context.scene.brume, "use_clean", text="")

    def draw(self, context):
        layout, settings = self.layout, context.scene.brume
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.active = settings.use_clean
        layout.prop(settings, "filter")


class BRUME_RENDER_PT_film(_BrumePanel, bpy.types.Panel):
    bl_label = "Film"
    bl_context = "render"
    bl_order = -3
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        self.layout.use_property_split = True
        self.layout.use_property_decorate = False
        self.layout.prop(context.scene.render, "film_transparent", text="Transparent")
        if hasattr(context.scene, "cycles"):
            self.layout.prop(context.scene.cycles, "film_exposure")


class BRUME_RENDER_PT_motion_blur(_BrumePanel, bpy.types.Panel):
    bl_label = "Motion Blur"
    bl_context = "render"
    bl_order = -2
    bl_options = {"DEFAULT_CLOSED"}

    def draw_header(self, context):
        self.layout.prop(context.scene.render, "use_motion_blur", text="")

    def draw(self, context):
        render = context.scene.render
        self.layout.use_property_split = True
        self.layout.active = render.use_motion_blur
        self.layout.prop(render, "motion_blur_shutter")


class BRUME_RENDER_PT_performance(_BrumePanel, bpy.types.Panel):
    bl_label = "Performance"
    bl_context = "render"
    bl_order = -1
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout, render = self.layout, context.scene.render
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.prop(render, "threads_mode")
        row = layout.row()
        row.active = render.threads_mode == "FIXED"
        row.prop(render, "threads")
        layout.prop(context.scene.brume, "bake_millions")


class BRUME_LIGHT_PT_light(_BrumePanel, bpy.types.Panel):
    bl_label = "Light"
    bl_context = "data"
    bl_order = -1

    @classmethod
    def poll(cls, context):
        return context.light is not None and super().poll(context)

    def draw(self, context):
        layout, light = self.layout, context.light
        layout.row().prop(light, "type", expand=True)
        layout.use_property_split = True
        col = layout.column()
        for name in ("color", "use_temperature", "temperature", "energy", "exposure", "normalize"):
            if hasattr(light, name):  # some since Blender 4.5
                col.prop(light, name)
        col = layout.column()
        if light.type == "SUN":
            col.prop(light, "angle")
        elif light.type == "POINT":
            col.prop(light, "shadow_soft_size", text="Radius")
        elif light.type == "AREA":
            col.prop(light, "shape")
            two = light.shape in ("RECTANGLE", "ELLIPSE")
            col.prop(light, "size", text="Size X" if two else "Size")
            if two:
                col.prop(light, "size_y", text="Y")
        layout.prop(light, "use_nodes")


class BRUME_OBJECT_PT_visibility(_BrumePanel, bpy.types.Panel):
    bl_label = "Rays and Masks"
    bl_context = "object"
    bl_parent_id = "OBJECT_PT_visibility"

    @classmethod
    def poll(cls, context):
        return context.object is not None and context.object.type in (*MESH_LIKE, "LIGHT") and super().poll(context)

    def draw(self, context):
        layout, thing = self.layout, context.object
        layout.use_property_split = True
        layout.prop(thing, "visible_camera", text="Camera")
        if thing.type != "LIGHT":
            layout.prop(thing, "is_holdout")
            layout.prop(thing, "is_shadow_catcher")


class BRUME_VIEWLAYER_PT_passes(_BrumePanel, bpy.types.Panel):
    bl_label = "Passes"
    bl_context = "view_layer"

    def draw(self, context):
        layout, view_layer = self.layout, context.view_layer
        layout.use_property_split = True
        layout.use_property_decorate = False
        col = layout.column(heading="Data", align=True)
        for name in ("z", "mist", "position", "normal", "vector"):
            col.prop(view_layer, f"use_pass_{name}")
        col = layout.column(heading="Volume", align=True)
        col.prop(view_layer.brume, "use_pass_volume_direct", text="Direct")
        col.prop(view_layer.brume, "use_pass_volume_indirect", text="Indirect")
        col = layout.column(heading="Surface", align=True)
        for name, text in (("diffuse_direct", "Direct"), ("diffuse_indirect", "Indirect"), ("diffuse_color", "Color")):
            col.prop(view_layer, f"use_pass_{name}", text=text)
        col = layout.column(heading="Other", align=True)
        for name in ("emit", "environment"):
            col.prop(view_layer, f"use_pass_{name}")
        col.prop(view_layer.brume, "use_pass_noisy")
        layout.prop(view_layer.brume, "layers")


class BRUME_OUTPUT_PT_clean_animation(bpy.types.Panel):
    bl_label = "Clean a Cycles Animation"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "output"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        return context.engine in ("CYCLES", ENGINE)

    def draw(self, context):
        layout, settings = self.layout, context.scene.brume
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.prop(settings, "animation_files")
        layout.prop(settings, "animation_suffix")
        layout.operator(BRUME_OT_clean_animation.bl_idname, icon="RENDER_ANIMATION")


CLASSES = (
    BRUME_RENDER_PT_sampling,
    BRUME_RENDER_PT_clean,
    BRUME_RENDER_PT_film,
    BRUME_RENDER_PT_motion_blur,
    BRUME_RENDER_PT_performance,
    BRUME_LIGHT_PT_light,
    BRUME_OBJECT_PT_visibility,
    BRUME_VIEWLAYER_PT_passes,
    BRUME_OUTPUT_PT_clean_animation,
)


# Where Blender decides by the engine which shader nodes its Add menu has.
MENUS = ("nodeitems_builtins", "bl_ui.node_add_menu_shader")  # until 3.x, since 4.0
ADDED = "eevee_cycles_shader_nodes_poll"  # function of those that both of its engines have


def _has_shaders(context):
    return context.engine in {"CYCLES", "BLENDER_EEVEE", "BLENDER_EEVEE_NEXT", "BRUME"}


_codes = {}  # of Blender's functions, as they were


def _offer_shaders():
    """Puts brume among the engines of Blender's own functions, whose items refer to the functions themselves."""
    for name in MENUS:
        try:
            function = getattr(importlib.import_module(name), ADDED, None)
        except ImportError:
            continue
        if function is not None:
            _codes[function] = function.__code__
            function.__code__ = _has_shaders.__code__


def register():
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    for panel in bpy.types.Panel.__subclasses__():
        if _takes(panel):
            panel.COMPAT_ENGINES = panel.COMPAT_ENGINES | {ENGINE}  # a set that other panels may share
    _offer_shaders()


def unregister():
    for function, code in _codes.items():
        function.__code__ = code
    _codes.clear()
    for panel in bpy.types.Panel.__subclasses__():
        if ENGINE in getattr(panel, "COMPAT_ENGINES", ()):
            panel.COMPAT_ENGINES = panel.COMPAT_ENGINES - {ENGINE}
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
