"""Makes a cloud of NumPy's noise and looks at it from all sides, clean at 8 samples per pixel.

usage: turn_a_cloud.py [--size PIXELS] [--views COUNT] [--voxels COUNT] [--folder FOLDER]

The light in the cloud is solved once for all views. Writes turn_0.png, turn_1.png, ... and evening.png, for which only
the light is another.
"""

import argparse
import pathlib

import numpy as np

import brume

arguments = argparse.ArgumentParser(description=__doc__.split("\n")[0])
arguments.add_argument("--size", type=int, default=320, help="side of the pictures [px]")
arguments.add_argument("--views", type=int, default=8)
arguments.add_argument("--voxels", type=int, default=128, help="along each axis of the cloud")
arguments.add_argument("--folder", type=pathlib.Path, default=pathlib.Path("."), help="where to write")
options = arguments.parse_args()


def cloud(n: int) -> np.ndarray:
    """A density of n x n x n: a flattened ball, its rim eaten by noise whose power falls with the frequency."""
    k = np.fft.fftfreq(n, 1 / n)
    frequency = np.sqrt(k[:, None, None] ** 2 + k[None, :, None] ** 2 + k[None, None, :] ** 2)
    frequency[0, 0, 0] = np.inf
    noise = np.fft.ifftn(np.fft.fftn(np.random.default_rng(4).standard_normal((n, n, n))) / frequency**1.8).real
    noise /= noise.std()
    x, y, z = np.meshgrid(*[np.linspace(-1, 1, n)] * 3, indexing="ij")
    ball = 1 - np.sqrt(x**2 + y**2 + (1.5 * z) ** 2) / 0.75
    return np.clip(6 * (ball + 0.22 * noise), 0, 1)


# Two units across, its middle at the origin; below it a ground of one square.
voxel = 2 / (options.voxels - 1)
scene = brume.Scene({
    "camera": {"position": [0, -5, 1], "look_at": [0, 0, -0.1], "fov": 27},
    "film": {"width": options.size, "height": options.size},
    "environment": {"radiance": [0.22, 0.28, 0.40]},
    "volumes": [{"density": cloud(options.voxels), "voxel_size": voxel, "origin": [-1, -1, -1],
                 "sigma_t": 18, "albedo": 0.99, "g": 0.5}],
    "surfaces": [{"vertices": [[-9, -9, -1.1], [9, -9, -1.1], [9, 9, -1.1], [-9, 9, -1.1]], "faces": [[0, 1, 2, 3]],
                  "albedo": [0.32, 0.30, 0.27]}],
    "lights": [{"type": "sun", "direction": [-0.7, -0.4, 0.7], "irradiance": [3.2, 2.9, 2.4]}],
})

for i, angle in enumerate(np.linspace(0, 2 * np.pi, options.views, endpoint=False)):
    eye = [5 * np.sin(angle), -5 * np.cos(angle), 1.2]
    frame = scene.render(spp=8, clean=True, camera__position=eye, png=options.folder / f"turn_{i}.png")
    print(f"turn_{i}.png: estimated error {frame.header['estimatedCleanError']:.3f}")
print(f"light was solved {scene.counts['lights_solved']} time(s) for {options.views} views")

scene.render(spp=8, clean=True, png=options.folder / "evening.png", environment__radiance=[0.16, 0.15, 0.22],
             lights__0__direction=[-0.9, -0.2, 0.12], lights__0__irradiance=[3.4, 1.7, 0.7])
print(f"evening.png: and once more, for another light: {scene.counts['lights_solved']}")
