"""Light groups of a view layer: which there are, and how the viewport mixes them. Nothing is rendered again for a mix, and
what F12 renders is not mixed."""

import bpy
from bpy.props import FloatProperty, FloatVectorProperty, StringProperty

from .translate.light_groups import group_names

ENGINE = "BRUME"
REST = "rest"  # what brume calls the light of everything without a group


def _redraw(self, context):
    """A changed mix is shown by the next drawing of a viewport."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


class BrumeLightMix(bpy.types.PropertyGroup):
    name: StringProperty(description="Of the light group; empty: everything without one")
    gain: FloatProperty(
        name="Gain", description="What the light of the group is multiplied by in the viewport", default=1, min=0, max=1e6, soft_max=4,
        update=_redraw,
    )  # fmt: skip
    colour: FloatVectorProperty(
        name="Colour", description="The same, by colour", subtype="COLOR", default=(1, 1, 1), min=0, max=1, update=_redraw
    )


def entry_of(view_layer, group):
    """How a group is mixed; None: as rendered, and sync() has not seen it yet."""
    return next((entry for entry in view_layer.brume.mix if entry.name == group), None)


def _groups_of(view_layer):
    return [group.name for group in view_layer.lightgroups] + [""] if len(view_layer.lightgroups) else []


def sync(view_layer):
    """Has an entry for each of a view layer's groups."""
    for group in _groups_of(view_layer):
        if entry_of(view_layer, group) is None:
            view_layer.brume.mix.add().name = group


def _sync_all():
    for scene in bpy.data.scenes:
        for view_layer in scene.view_layers:
            sync(view_layer)


def mix_of(view_layer, known):
    """Factors that are not 1, by brume's names of the groups, as docs/view.md has them.
    @param known  groups that the program has in the scene"""
    names, mix = group_names(view_layer), {}
    for entry in view_layer.brume.mix:
        name = names.get(entry.name) if entry.name else REST
        factor = [entry.gain * c for c in entry.colour]
        if name in known and factor != [1, 1, 1]:
            mix[name] = factor
    return mix


class BRUME_OT_reset_light_mix(bpy.types.Operator):
    bl_idname = "brume.reset_light_mix"
    bl_label = "As Rendered"
    bl_description = "All light groups as they are rendered"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context):
        for entry in context.view_layer.brume.mix:
            entry.property_unset("gain")
            entry.property_unset("colour")
        _redraw(self, context)
        return {"FINISHED"}


def _draw_mix(layout, view_layer):
    layout.prop(view_layer.brume, "use_mix")
    layout = layout.column()
    layout.active = view_layer.brume.use_mix
    groups = _groups_of(view_layer)
    entries = {group: entry_of(view_layer, group) for group in groups}
    if None in entries.values() and not bpy.app.timers.is_registered(_sync_all):
        bpy.app.timers.register(_sync_all)  # nothing may be changed while Blender draws
    col = layout.column(align=True)
    for group, entry in entries.items():
        row = col.split(factor=0.35, align=True)
        row.label(text=group or "Others")
        if entry is not None:
            row = row.split(factor=0.75, align=True)
            row.prop(entry, "gain", text="", slider=True)
            row.prop(entry, "colour", text="")
    layout.operator(BRUME_OT_reset_light_mix.bl_idname)


class _Panel:
    @classmethod
    def poll(cls, context):
        return context.engine == ENGINE


class BRUME_VIEWLAYER_PT_light_groups(_Panel, bpy.types.Panel):
    bl_label = "Light Groups"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "view_layer"

    def draw(self, context):
        layout, view_layer = self.layout, context.view_layer
        row = layout.row()
        row.template_list("UI_UL_list", "lightgroups", view_layer, "lightgroups", view_layer, "active_lightgroup_index", rows=3)
        col = row.column(align=True)
        col.operator("scene.view_layer_add_lightgroup", icon="ADD", text="")
        col.operator("scene.view_layer_remove_lightgroup", icon="REMOVE", text="")
        col.separator()
        col.menu("VIEWLAYER_MT_lightgroup_sync", icon="DOWNARROW_HLT", text="")
        if len(view_layer.lightgroups):
            _draw_mix(layout, view_layer)


class BRUME_VIEW3D_PT_light_mix(_Panel, bpy.types.Panel):
    bl_label = "Light Mix"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "View"

    @classmethod
    def poll(cls, context):
        return super().poll(context) and len(context.view_layer.lightgroups) > 0

    def draw(self, context):
        _draw_mix(self.layout, context.view_layer)


class BRUME_OBJECT_PT_light_group(_Panel, bpy.types.Panel):
    bl_label = "Light Group"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "object"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        self.layout.prop_search(context.object, "lightgroup", context.view_layer, "lightgroups", text="")


class BRUME_WORLD_PT_light_group(_Panel, bpy.types.Panel):
    bl_label = "Light Group"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "world"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        return super().poll(context) and context.world is not None

    def draw(self, context):
        self.layout.prop_search(context.world, "lightgroup", context.view_layer, "lightgroups", text="")


CLASSES = (
    BRUME_OT_reset_light_mix,
    BRUME_VIEWLAYER_PT_light_groups,
    BRUME_VIEW3D_PT_light_mix,
    BRUME_OBJECT_PT_light_group,
    BRUME_WORLD_PT_light_group,
)


def register():
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister():
    if bpy.app.timers.is_registered(_sync_all):
        bpy.app.timers.unregister(_sync_all)
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
