"""Mean of 3 x 3 pixels, from one portable float map to another; needs nothing but NumPy.

usage: mean.py INPUT.pfm OUTPUT.pfm
"""

import sys

import numpy as np


def read_pfm(path):
    """Height x width x 3, the top row first."""
    with open(path, "rb") as file:
        assert file.readline() == b"PF\n", "expected a colour PFM"
        width, height = map(int, file.readline().split())
        scale = float(file.readline())
        pixels = np.frombuffer(file.read(), "<f4" if scale < 0 else ">f4")
    return pixels.reshape(height, width, 3)[::-1]  # its rows go from the bottom up


def write_pfm(path, picture):
    with open(path, "wb") as file:
        file.write(b"PF\n%d %d\n-1.0\n" % (picture.shape[1], picture.shape[0]))
        file.write(picture[::-1].astype("<f4").tobytes())


picture = np.pad(read_pfm(sys.argv[1]), ((1, 1), (1, 1), (0, 0)), mode="edge")
height, width = picture.shape[0] - 2, picture.shape[1] - 2
write_pfm(sys.argv[2], sum(picture[y : y + height, x : x + width] for y in range(3) for x in range(3)) / 9)
