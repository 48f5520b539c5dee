"""World matrices as brume takes them: with an inverse."""

from .notes import LeftOut

THIN = 1e-6  # length of an axis that is scaled to 0, over the longest


def invertible(matrix, flat_is_seen):
    """The matrix; of an object that is scaled flat, with a thin third axis; None: there is nothing to see of an object that is
    scaled to a line or a point, nor of a flat volume. @throws LeftOut: its axes lie in a plane"""
    axes = [matrix.col[i].to_3d() for i in range(3)]
    lengths = [axis.length for axis in axes]
    if 0 in lengths:
        flat = lengths.index(0)
        normal = axes[flat - 2].cross(axes[flat - 1])
        if not (flat_is_seen and normal.length > 0):
            return None
        matrix = matrix.copy()
        matrix.col[flat] = (*(THIN * max(lengths) * normal.normalized()), 0)
    elif not abs(axes[0].normalized().cross(axes[1].normalized()).dot(axes[2].normalized())) > 1e-9:
        raise LeftOut("it is sheared flat")
    return matrix


def matrices_of(instance, motion, notes):
    """(as the shutter opens, as it closes), the second None where an object stands still; None: it is scaled to nothing.
    @throws LeftOut"""
    thing = instance.object
    flat_is_seen = thing.type != "VOLUME"
    still = invertible(instance.matrix_world.copy(), flat_is_seen)
    moved = motion.matrices(instance) if motion is not None else None
    if moved is not None:
        moved = [invertible(matrix, flat_is_seen) for matrix in moved]
        if None not in moved:
            return tuple(moved)
        notes.say(thing.name, "is scaled to nothing while the shutter is open, which is left out of the motion blur")
    return still and (still, None)
