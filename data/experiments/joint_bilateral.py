"""Joint bilateral filter: weights from the colours, by how noisy they are, and from the transmittance beside them.

usage: joint_bilateral.py FRAME OUTPUT [--radius PIXELS]

FRAME is an EXR of `brume evaluate` with the layer transmittance and statistics.
"""

import argparse

import brume
import numpy as np

arguments = argparse.ArgumentParser(description=__doc__.split("\n")[0])
arguments.add_argument("frame")
arguments.add_argument("output")
arguments.add_argument("--radius", type=int, default=4, help="half width of the window [px]")
options = arguments.parse_args()

frame = brume.read(options.frame)
colour = frame.image()
variance = frame.image(statistic="mean_variance").mean(axis=2)
transmittance = frame.image("transmittance").mean(axis=2)

# The noise of a pixel by itself is noisy, too.
height, width = variance.shape
padded = np.pad(variance, 2, mode="edge")
variance = sum(padded[y : y + height, x : x + width] for y in range(5) for x in range(5)) / 25 + 1e-8


def shifted(array, dy, dx):
    """The neighbour at (dy, dx) of every pixel, edges repeated."""
    rows = np.clip(np.arange(height) + dy, 0, height - 1)
    columns = np.clip(np.arange(width) + dx, 0, width - 1)
    return array[rows][:, columns]


total = np.zeros_like(colour)
weights = np.zeros_like(variance)
for dy in range(-options.radius, options.radius + 1):
    for dx in range(-options.radius, options.radius + 1):
        other = shifted(colour, dy, dx)
        difference = ((other - colour) ** 2).mean(axis=2) / (variance + shifted(variance, dy, dx))
        edge = (shifted(transmittance, dy, dx) - transmittance) ** 2 / 0.02
        near = (dy * dy + dx * dx) / (0.5 * options.radius) ** 2
        weight = np.exp(-0.5 * (near + edge + 0.2 * difference))
        total += weight[:, :, None] * other
        weights += weight
brume.write(options.output, {"beauty": total / weights[:, :, None]})
