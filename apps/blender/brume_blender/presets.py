"""Settings for two purposes."""

import bpy
from bpy.props import EnumProperty

PRESETS = {
    "preview": ("Preview", "Four samples per pixel, clean: lets one judge light and composition", {"samples": 4}),
    "final": (
        "Final",
        "As many samples as it takes for an estimated error of 0.3 % of the picture, clean",
        {"use_error": True, "error": 0.003},
    ),
}
COMMON = {"use_clean": True, "use_time": False, "use_error": False, "filter": "transport_regression"}


def apply(settings, name):
    for key, value in {**COMMON, **PRESETS[name][2]}.items():
        setattr(settings, key, value)


class BRUME_OT_preset(bpy.types.Operator):
    """Sets samples, limits and cleaning for a purpose"""

    bl_idname = "brume.preset"
    bl_label = "brume Preset"
    bl_options = {"REGISTER", "UNDO"}

    preset: EnumProperty(name="Preset", items=[(key, name, text) for key, (name, text, _) in PRESETS.items()])

    @classmethod
    def description(cls, context, properties):
        return PRESETS[properties.preset][1]

    def execute(self, context):
        apply(context.scene.brume, self.preset)
        return {"FINISHED"}


def register():
    bpy.utils.register_class(BRUME_OT_preset)


def unregister():
    bpy.utils.unregister_class(BRUME_OT_preset)
