"""What a viewport's region looks at: its camera in brume's terms, and the part of it that is rendered."""

import math

from .translate.camera import focus_of, lens_keys
from .translate.toml_text import Table

WHOLE = (0.0, 0.0, 1.0, 1.0)


def _camera(context, scene):
    """The camera that is looked through; None: none is."""
    space = context.space_data
    camera = space.camera if getattr(space, "use_local_camera", False) else scene.camera
    looks = context.region_data.view_perspective == "CAMERA" and camera is not None and camera.type == "CAMERA"
    return camera if looks else None


def _border_of(context, scene):
    """(left, bottom, right, top) of the region that is rendered, 0 to 1: by Ctrl B, of a camera by the render's border."""
    space, region = context.space_data, context.region_data
    camera = _camera(context, scene)
    if camera is None:
        border = (space.render_border_min_x, space.render_border_min_y, space.render_border_max_x, space.render_border_max_y)
        return border if space.use_render_border and border[0] < border[2] and border[1] < border[3] else WHOLE
    render = scene.render
    if not render.use_border:
        return WHOLE
    corners = [region.perspective_matrix @ (camera.matrix_world.normalized() @ c).to_4d() for c in camera.data.view_frame(scene=scene)]
    xs, ys = ([0.5 + 0.5 * c[i] / c[3] for c in corners] for i in (0, 1))
    left, bottom, across, up = min(xs), min(ys), max(xs) - min(xs), max(ys) - min(ys)
    border = (
        left + render.border_min_x * across, bottom + render.border_min_y * up,
        left + render.border_max_x * across, bottom + render.border_max_y * up,
    )  # fmt: skip
    border = tuple(min(max(edge, 0.0), 1.0) for edge in border)
    return border if border[0] < border[2] and border[1] < border[3] else WHOLE


def place_of(context, scene):
    """What is rendered of the region, in whole pixels: (left, bottom, right, top)."""
    width, height = context.region.width, context.region.height
    left, bottom, right, top = _border_of(context, scene)
    x0, y0 = int(left * width), int(bottom * height)
    return x0, y0, max(round(right * width), x0 + 1), max(round(top * height), y0 + 1)


def camera_of(context, scene, depsgraph, place, extent):
    """([camera] as a Table, how far from the origin it is).
    @param place  of the picture, in pixels   @param extent  from the origin to what lies farthest from it"""
    region, pixels = context.region_data, (context.region.width, context.region.height)
    border = [edge / pixels[i % 2] for i, edge in enumerate(place)]
    projection, matrix = region.window_matrix, region.view_matrix.inverted()
    up, back = (matrix.to_3x3().col[i].normalized() for i in (1, 2))
    position = matrix.translation.copy()
    across, upright = border[2] - border[0], border[3] - border[1]
    camera = _camera(context, scene)
    perspective = region.is_perspective if camera is None else camera.data.type != "ORTHO"
    # Of the window's middle, in windows; and of the border's.
    centre = [projection[i][2] / 2 if perspective else -projection[i][3] / 2 for i in (0, 1)]
    shift = (
        (centre[0] + 0.5 * (border[0] + border[2]) - 0.5) / across,
        (centre[1] + 0.5 * (border[1] + border[3]) - 0.5) / upright,
    )
    table = Table("[camera]")
    if perspective:
        table.set(type="perspective", fov=math.degrees(2 * math.atan(across / projection[0][0])))
    else:
        table.set(type="orthographic", width=2 * across / projection[0][0])
        if camera is None:
            position += (position.length + extent) * back  # the viewport sees what lies behind it, too
    table.set(position=position, look_at=position - back, up=up, fov_axis="x", shift=shift)
    if camera is not None and camera.data.dof.use_dof:
        camera = camera.evaluated_get(depsgraph)
        focus = focus_of(camera, depsgraph)
        table.set(look_at=position - (focus or 1.0) * back, **lens_keys(camera.data, focus))
    else:
        table.set(lens_radius=0)
    return table, position.length
