"""Packs the add-on: one zip, an extension for Blender 4.2 and later and an add-on for those before.

    python3 apps/blender/make_zip.py build/brume_blender.zip [PROGRAM] [--carry]

PROGRAM is the brume that the add-on takes unless its preferences say another: its path is written into the zip. With
--carry it goes into the zip itself, with the brume-vdb-reader beside it.

All files lie in one folder: an add-on's zip must have it, and Blender 4.2 looks for the manifest there, too
(pkg_zipfile_detect_subdir_or_none in Blender's bl_pkg/cli/blender_ext.py).
"""

import os
import sys
import zipfile

HERE = os.path.dirname(os.path.abspath(__file__))
PACKAGE = "brume_blender"
DATE = (2020, 1, 1, 0, 0, 0)  # of every file: the same sources make the same bytes
CARRIED = ("brume", "brume-vdb-reader")


def sources():
    """Pairs of a path in the zip and the file."""
    yield f"{PACKAGE}/LICENSE", os.path.join(HERE, "..", "..", "LICENSE")
    for folder, folders, files in os.walk(os.path.join(HERE, PACKAGE)):
        folders[:] = sorted(f for f in folders if f != "__pycache__")
        for name in sorted(f for f in files if f.endswith((".py", ".toml"))):
            path = os.path.join(folder, name)
            yield os.path.relpath(path, HERE), path


def write(output, program=None, carry=False):
    part = output + ".part"
    with zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as archive:

        def add(name, data, mode=0o644):
            info = zipfile.ZipInfo(name, DATE)
            info.external_attr = mode << 16
            info.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(info, data)

        def add_file(name, path, mode=0o644):
            with open(path, "rb") as file:
                add(name, file.read(), mode)

        for name, path in sources():
            add_file(name, path)
        if program and carry:
            for name in CARRIED:
                add_file(f"{PACKAGE}/bin/{name}", os.path.join(os.path.dirname(os.path.abspath(program)), name), 0o755)
        elif program:
            add(f"{PACKAGE}/program_path.txt", os.path.abspath(program) + "\n")
    os.replace(part, output)


if __name__ == "__main__":
    words = [word for word in sys.argv[1:] if word != "--carry"]
    carry = len(words) < len(sys.argv) - 1
    if len(words) not in (1, 2) or (carry and len(words) < 2) or any(word.startswith("-") for word in words):
        sys.exit("make_zip: expected: make_zip.py OUT.zip [PROGRAM] [--carry]")
    try:
        write(*words, carry=carry)
    except OSError as problem:
        sys.exit(f"make_zip: {problem}")
    print(words[0])
