"""The part of viewport_window.py in which light groups are mixed."""

import time

import bpy
import numpy as np

from brume_blender import light_mix
from brume_blender import viewport as own


def mean_of(view):
    return view._shown.values.astype(np.float64).mean((1, 2))


def steps(scenario, seen):
    """Switches the lamp off in the mix, and then in the scene: both look alike, and the first is there at once."""
    view, layer = next(iter(own._viewports.values())), bpy.context.view_layer
    lamp = bpy.data.objects["Lamp"]
    rests = scenario.later(lambda: scenario.shown("clean") and not bpy.app.timers.is_registered(view._timer))
    layer.lightgroups.add(name="key light")
    lamp.lightgroup = "key light"
    bpy.msgbus.publish_rna(key=(bpy.types.Object, "lightgroup"))  # as Blender's interface does
    yield lambda: view._live.light_groups() == ["rest", "key_light"] or view._live.light_groups() == ["key_light", "rest"]
    yield rests
    light_mix.sync(layer)
    yield scenario.later(rests)
    before, revision, number, picture = mean_of(view), view._revision, view._number, view._shown
    began = time.monotonic()
    light_mix.entry_of(layer, "key light").gain = 0
    yield lambda: view._shown is not picture
    mixed = seen["mix"] = {"seconds": time.monotonic() - began, "stage": view._shown.about["stage"]}
    mixed["samples"], mixed["looks"] = view._shown.about["samples"], view._number - number
    mixed["read_again"] = view._revision - revision
    yield scenario.later(rests)
    scenario.compare("mixed")
    mixed["state"], without = view._state(), mean_of(view)
    # Faster than they are answered: the newest counts.
    for step in range(1, 21):
        light_mix.entry_of(layer, "").gain = 0.1 * step
        yield lambda: True
    yield lambda: view._live.rests() and view._look["mix"].get("rest") == [2, 2, 2] and scenario.answered()()
    mixed["twice"] = (mean_of(view) / without).tolist()
    bpy.ops.brume.reset_light_mix()
    yield scenario.later(rests)
    mixed["reset"] = bool(np.array_equal(view._shown.values, picture.values))
    energy, lamp.data.energy = lamp.data.energy, 0
    yield scenario.later(scenario.answered())
    yield scenario.later(rests)
    mixed["before"], mixed["without"], mixed["rendered"] = before.tolist(), without.tolist(), mean_of(view).tolist()
    lamp.data.energy, lamp.lightgroup = energy, ""
    layer.active_lightgroup_index = 0
    bpy.ops.scene.view_layer_remove_lightgroup()
    lamp.data.update_tag()
    yield scenario.later(scenario.answered())
