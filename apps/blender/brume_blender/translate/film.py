"""The picture: size, shape of its pixels, exposure."""

from .toml_text import Table


def film_size(scene):
    """Pixels across and down, as Blender renders them."""
    render = scene.render
    share = render.resolution_percentage
    return max(1, render.resolution_x * share // 100), max(1, render.resolution_y * share // 100)


def pixel_aspect_of(scene):
    """Width of a pixel over its height."""
    return scene.render.pixel_aspect_x / scene.render.pixel_aspect_y


def film_table(scene, width, height, notes):
    table = Table("[film]").set(width=width, height=height)
    table.set(exposure=2**scene.view_settings.exposure)
    factor = getattr(getattr(scene, "cycles", None), "film_exposure", 1.0)
    if factor != 1:
        notes.say("Film", f"the exposure of Cycles, {factor:.4g}, is left out; the scene's own in Color Management is kept")
    return table
