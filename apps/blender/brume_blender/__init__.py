"""The render engine brume for Blender: F12 renders with the program brume, which runs beside Blender."""

bl_info = {
    "name": "brume",
    "author": "The brume authors",
    "version": (0, 1, 0),
    "blender": (3, 4, 0),
    "location": "Render Properties > Render Engine",
    "description": "Renders smoke, clouds and fire without noise, and cleans animations of Cycles",
    "category": "Render",
}

from . import engine, operators, panels, presets, properties  # noqa: E402

MODULES = (properties, engine, presets, operators, panels)


def register():
    for module in MODULES:
        module.register()


def unregister():
    for module in reversed(MODULES):
        module.unregister()
