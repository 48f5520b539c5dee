"""Writes land.ply and clouds.csv of ../sunset.toml: hills, and 300 places of clouds. Lengths in kilometres.

    python3 data/scenes/sunset/make.py
"""

import math
import pathlib
import random
import struct

FOLDER = pathlib.Path(__file__).parent


def noise(x, y, seed):
    """Smooth noise in 0 .. 1 from a lattice of random values."""

    def value(i, j):
        return random.Random(f"{i} {j} {seed}").random()

    i, j = math.floor(x), math.floor(y)
    u, v = x - i, y - j
    u, v = u * u * (3 - 2 * u), v * v * (3 - 2 * v)
    low = value(i, j) * (1 - u) + value(i + 1, j) * u
    high = value(i, j + 1) * (1 - u) + value(i + 1, j + 1) * u
    return low * (1 - v) + high * v


def height(x, y):
    """Ridges that grow with the distance; a wide valley leads away from the eye."""
    ridge, size, weight = 0.0, 9.0, 0.5
    for octave in range(4):
        n = noise(x / size, y / size, octave)
        ridge += weight * (1 - abs(2 * n - 1)) ** 1.5
        size, weight = size / 2.1, weight / 2.1
    valley = 1 - math.exp(-((x - 0.12 * y) / (2.5 + 0.09 * y)) ** 2)
    return (0.12 + 0.75 * valley * min(1.0, y / 25 + 0.35)) * ridge


def land():
    columns, rows = 80, 90
    points = []
    for j in range(rows):
        y = -2 + 62 * (j / (rows - 1)) ** 1.8  # finer near the eye
        for i in range(columns):
            x = (2 * i / (columns - 1) - 1) * (5 + 0.75 * max(y, 0))
            points.append((x, y, height(x, y)))
    faces = []
    for j in range(rows - 1):
        for i in range(columns - 1):
            a = j * columns + i
            faces += [(a, a + 1, a + columns + 1), (a, a + columns + 1, a + columns)]
    head = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        f"element face {len(faces)}\nproperty list uchar ushort vertex_indices\nend_header\n"
    )
    body = b"".join(struct.pack("<3f", *p) for p in points) + b"".join(struct.pack("<B3H", 3, *f) for f in faces)
    (FOLDER / "land.ply").write_bytes(head.encode() + body)


def clouds(count=300):
    rng = random.Random(49)
    places = []
    while len(places) < count:
        y = 4 + 56 * rng.random() ** 0.8
        x = (2 * rng.random() - 1) * (3 + 0.7 * y)
        # Denser in streets that run away from the eye.
        if rng.random() > 0.25 + 0.75 * noise(x / 5, y / 12, "streets"):
            continue
        size = 0.22 + 0.5 * rng.random() ** 2
        if any(math.hypot(x - a, y - b) < 1.15 * (size + s) for a, b, s in places):
            continue
        places.append((x, y, size))
    lines = ["x,y,z,orient_x,orient_y,orient_z,orient_w,pscale,density"]
    for x, y, size in places:
        turn, flat = math.pi * rng.random(), 1.45 + 0.12 * rng.random()
        lines.append(
            f"{x:.3f},{y:.3f},{flat:.3f},0,0,{math.sin(turn):.4f},{math.cos(turn):.4f},{size:.3f},{0.7 + 0.6 * rng.random():.2f}"
        )
    (FOLDER / "clouds.csv").write_text("\n".join(lines) + "\n")


land()
clouds()
