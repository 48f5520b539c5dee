"""Packs the add-on for Blender's Edit > Preferences > Add-ons > Install.

    python3 apps/blender/make_zip.py build/brume_blender.zip [PROGRAM]

PROGRAM is the brume that the add-on takes unless its preferences say another: its path is written into the zip.
"""

import os
import sys
import zipfile

HERE = os.path.dirname(os.path.abspath(__file__))
PACKAGE = "brume_blender"
DATE = (2020, 1, 1, 0, 0, 0)  # of every file: the same sources make the same bytes


def sources():
    """Pairs of a path in the zip and the file."""
    yield f"{PACKAGE}/LICENSE", os.path.join(HERE, "..", "..", "LICENSE")
    for folder, folders, files in os.walk(os.path.join(HERE, PACKAGE)):
        folders[:] = sorted(f for f in folders if f != "__pycache__")
        for name in sorted(f for f in files if f.endswith(".py")):
            path = os.path.join(folder, name)
            yield os.path.relpath(path, HERE), path


def write(output, program=None):
    part = output + ".part"
    with zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as archive:

        def add(name, data):
            info = zipfile.ZipInfo(name, DATE)
            info.external_attr = 0o644 << 16
            info.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(info, data)

        for name, path in sources():
            with open(path, "rb") as file:
                add(name, file.read())
        if program:
            add(f"{PACKAGE}/program_path.txt", os.path.abspath(program) + "\n")
    os.replace(part, output)


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3):
        sys.exit("make_zip: expected: make_zip.py OUT.zip [PROGRAM]")
    write(*sys.argv[1:])
    print(sys.argv[1])
