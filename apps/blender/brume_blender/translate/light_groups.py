"""Light groups of a view layer: what shines is of the group that its object names (docs/passes.md)."""

import re

import numpy as np

# Names that brume has a meaning of its own for, beside those that begin with bucket_.
TAKEN = ("", "rest", "half_a", "half_b", "mean_variance")


def group_names(view_layer):
    """Brume's names, of letters, digits, _ and -, by Blender's."""
    names = {}
    for group in view_layer.lightgroups:
        name = re.sub(r"[^A-Za-z0-9_-]", "_", group.name)
        while name in TAKEN or name.startswith("bucket_") or name in names.values():
            name = "_" + name
        names[group.name] = name
    return names


def group_of(thing):
    """Blender's name of an object's or a world's group. It evaluates nothing anew where another one is chosen."""
    return thing.original.lightgroup


def put_in_group(tables, name):
    """What shines of an object's tables. @param name  brume's; None: the object is of no group"""
    for table in tables:
        if name is not None and _shines(table):
            table.set(group=name)


def _shines(table):
    if table.header in ("[[lights]]", "[environment]"):
        return True
    constant = (table.value(key) for key in ("radiance", "emission"))
    return table.holds_any(("temperature_grid", "flame_grid")) or any(c is not None and np.any(np.array(c) > 0) for c in constant)
