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


def exposure_of(scene):
    """Cycles' Film > Exposure, a factor on all light that is shown or written."""
    return getattr(getattr(scene, "cycles", None), "film_exposure", 1.0)


def film_table(scene, width, height):
    table = Table("[film]").set(width=width, height=height)
    table.set(exposure=2**scene.view_settings.exposure * exposure_of(scene))
    return table
