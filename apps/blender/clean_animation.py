"""Cleans an animation that Cycles has rendered of this file as OpenEXR MultiLayer, with guides of its volumes.

    blender -b shot.blend --python apps/blender/clean_animation.py -- [frames=PATTERN] [suffix=_clean] [range=1-48] [filter=NAME]

frames  the files, with #### for the number; the scene's output unless given
suffix  put before the number in the clean files' names; suffix= replaces the files
range   the scene's frames unless given
filter  the best for the files unless given
"""

import os
import re
import sys

import bpy

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from brume_blender import program, sequence_cleaning  # noqa: E402
from brume_blender.child import CannotStart  # noqa: E402


def options():
    given = {}
    for word in sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []:
        key, equals, value = word.partition("=")
        if not equals or key not in ("frames", "suffix", "range", "filter"):
            raise SystemExit(f"clean_animation: '{word}': expected frames=, suffix=, range= or filter=")
        given[key] = value
    scene = bpy.context.scene
    first, last = scene.frame_start, scene.frame_end
    if "range" in given:
        found = re.fullmatch(r"(\d+)(?:-(\d+))?", given["range"])
        if not found:
            raise SystemExit(f"clean_animation: range={given['range']}: expected 7 or 1-48")
        first, last = int(found[1]), int(found[2] or found[1])
    return sequence_cleaning.Options(
        sequence_cleaning.pattern_of(given.get("frames") or scene.render.filepath),
        list(range(first, last + 1, scene.frame_step)),
        given.get("suffix", "_clean"),
        given.get("filter", ""),
    )


def main():
    chosen = options()
    told = None
    try:
        for share, what in sequence_cleaning.clean(bpy.context.scene, bpy.context.view_layer, chosen):
            if what != told:
                print(f"clean_animation: {what}, {100 * share:.0f} %", flush=True)
                told = what
    except (sequence_cleaning.Problem, program.NoProgram, CannotStart) as problem:
        raise SystemExit(f"clean_animation: {problem}") from None
    finally:
        for note in chosen.notes:
            print("clean_animation: " + note)
    print(f"clean_animation: {len(chosen.frames)} frames are clean")


main()
