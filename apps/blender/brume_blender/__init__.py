"""The render engine brume for Blender: F12 renders with the program brume, which runs beside Blender."""

bl_info = {  # for Blender before 4.2; later ones read blender_manifest.toml
    "name": "brume",
    "author": "The brume authors",
    "version": (0, 1, 0),
    "blender": (3, 4, 0),
    "location": "Render Properties > Render Engine",
    "description": "Renders smoke, clouds and fire without noise, and cleans animations of Cycles",
    "category": "Render",
}

import bpy  # noqa: E402

from . import engine, light_mix, operators, panels, presets, properties  # noqa: E402

MODULES = (properties, engine, presets, operators, panels, light_mix)


def _twin():
    """The name of another copy of this add-on that is enabled, as one from before Blender 4.2 is beside the extension."""
    names = (name for name in bpy.context.preferences.addons.keys() if name != __package__)
    return next((n for n in names if n.rpartition(".")[2] == "brume_blender" and hasattr(bpy.types.Scene, "brume")), None)


def register():
    twin = _twin()
    if twin:
        raise RuntimeError(f"brume is enabled as {twin}, too: disable one of the two in Edit > Preferences > Add-ons")
    for module in MODULES:
        module.register()


def unregister():
    for module in reversed(MODULES):
        module.unregister()
