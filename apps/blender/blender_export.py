"""Writes a Blender scene as a brume scene, with its meshes and pictures.

    blender -b shot.blend --python apps/blender/blender_export.py -- shot.toml [frame=12]

Then a render, or guides for a frame that Cycles rendered of it:

    brume render shot.toml -o shot.exr
    brume guides --like shot_0012.exr --scene shot.toml -o shot_0012.guides.exr
    brume denoise shot_0012.exr --guides shot_0012.guides.exr -o shot_0012.clean.exr

Meshes and pictures go into the folder shot_files beside the scene. What brume has no counterpart of is said, a line for
each kind, also in the scene (brume_blender/translate). Objects are as the viewport shows them: with its levels of
subdivision.
"""

import os
import socket
import sys

import bpy

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from brume_blender.translate import CannotTranslate, translate  # noqa: E402
from brume_blender.translate.film import exposure_of  # noqa: E402


def export(path):
    scene = bpy.context.scene
    depsgraph = bpy.context.evaluated_depsgraph_get()
    home = os.path.dirname(os.path.abspath(path))
    folder = os.path.splitext(os.path.abspath(path))[0] + "_files"
    os.makedirs(folder, exist_ok=True)

    def set_frame(frame, subframe):
        scene.frame_set(frame, subframe=subframe)

    try:
        result = translate(depsgraph, scene, folder, set_frame=set_frame, scene_folder=home)
    except CannotTranslate as reason:
        raise SystemExit(f"blender_export: {reason}") from None
    finally:
        if not os.listdir(folder):
            os.rmdir(folder)
    text = result.text
    if scene.render.use_border:
        border = "Render border: left out, the whole picture is exported"
        result.notes.append(border)
        text = f"# Left out: {border}\n" + text
    for note in result.notes:
        print("blender_export: " + note)
    if exposure_of(scene) != 1:
        exposure = f"Film exposure of Cycles: its {exposure_of(scene):.4g} is in PNGs and views of the scene, not in EXRs"
        result.notes.append(exposure)
        text = f"# Left out: {exposure}\n" + text
    part = f"{path}.{socket.gethostname()}.{os.getpid()}.part"
    with open(part, "w", encoding="utf-8") as out:
        out.write(text)
    os.replace(part, path)


def main():
    arguments = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []
    if not arguments:
        raise SystemExit("blender_export: expected: blender -b FILE.blend --python blender_export.py -- OUT.toml [frame=N]")
    for option in arguments[1:]:
        key, _, text = option.partition("=")
        if key != "frame" or not text.lstrip("-").isdigit():
            raise SystemExit(f"blender_export: '{option}': expected frame=N")
        bpy.context.scene.frame_set(int(text))
    export(arguments[0])


main()
