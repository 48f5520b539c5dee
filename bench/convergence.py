#!/usr/bin/env python3
"""Whether the clean frame converges: Lab RMS of the whole frame at 4 .. 4096 samples, clean and noisy, and in how many blocks
of 16 x 16 pixels it is worse than the noisy frame by 2 %, where its error is more than 0.2 % of the light; a Markdown table, and
with --plot an SVG of it.

    ./run python
    PYTHONPATH=build/python /usr/bin/python3 bench/convergence.py --cache build/convergence --plot docs/images/convergence.svg
"""

import argparse
import logging
import pathlib

import brume
import numpy as np

ROOT = pathlib.Path(__file__).resolve().parent.parent
SCENES = ["bench/scenes/general/floor_and_balls", "bench/scenes/general/behind_glass", "bench/scenes/general/fire_room",
          "bench/scenes/solid_smoke", "data/scenes/cloud"]
SAMPLES = [4, 16, 64, 256, 1024, 4096]
BLOCK, LEAST = 16, 0.002
COLOURS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#444444"]


def rgb(frame):
    return np.stack([np.asarray(frame[c], dtype=np.float64) for c in "RGB"], -1)


def block_errors(picture, references):
    """Squared relative errors, free of the references' noise."""
    a, b = (rgb(r) for r in references)
    squares = np.mean((rgb(picture) - a) * (rgb(picture) - b), -1) / (np.mean(0.5 * (a + b), -1) + 0.05) ** 2
    height, width = (n // BLOCK * BLOCK for n in squares.shape)
    return squares[:height, :width].reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK).mean((1, 3))


def measured(scene, options):
    """For each count of samples: error of the clean and of the noisy frame, worse blocks, all blocks."""
    def render(spp, seed, layers):
        path = options.cache / f"{pathlib.Path(scene).stem}_{options.size}_{spp}_{seed}.exr"
        if not path.exists():
            brume.write(path, brume.render(str(ROOT / f"{scene}.toml"), spp=spp, seed=seed, layers=layers, buckets=True,
                                           film__width=options.size, film__height=options.size * 3 // 4))
        return brume.read(path)

    references = [render(options.reference_spp, seed, "coverage") for seed in (101, 102)]
    for spp in SAMPLES:
        noisy = render(spp, 1, "direct,indirect,guides")
        clean = brume.denoise(noisy, "transport_regression")
        lab = [brume.metrics(f, *references)["lab_rms"] for f in (clean, noisy)]
        before, after = block_errors(noisy, references), block_errors(clean, references)
        yield *lab, int(np.sum((after > 1.02**2 * np.maximum(before, 0)) & (after > LEAST**2))), before.size


def plot(curves):
    """Error over samples, both logarithmic; clean full, noisy broken."""
    width, height, left, top = 720, 420, 60, 20
    errors = [e for rows in curves.values() for row in rows for e in row[:2] if e > 0]
    low, high = np.log10(min(errors)) - 0.1, np.log10(max(errors)) + 0.1
    x = lambda spp: left + (width - left - 160) * np.log(spp / SAMPLES[0]) / np.log(SAMPLES[-1] / SAMPLES[0])
    y = lambda e: top + (height - top - 50) * (high - np.log10(max(e, 10**low))) / (high - low)
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="sans-serif" font-size="13">',
           '<rect width="100%" height="100%" fill="white"/>']
    for spp in SAMPLES:
        out.append(f'<text x="{x(spp):.0f}" y="{height - 28}" text-anchor="middle">{spp}</text>')
    out.append(f'<text x="{(left + width - 160) / 2:.0f}" y="{height - 8}" text-anchor="middle">samples per pixel</text>')
    for e in (0.01, 0.03, 0.1, 0.3, 1, 3, 10):
        if low <= np.log10(e) <= high:
            out.append(f'<line x1="{left}" x2="{width - 160}" y1="{y(e):.0f}" y2="{y(e):.0f}" stroke="#ddd"/>'
                       f'<text x="{left - 8}" y="{y(e) + 4:.0f}" text-anchor="end">{e:g}</text>')
    for i, (name, rows) in enumerate(curves.items()):
        for column, dash in ((0, ""), (1, ' stroke-dasharray="4 4"')):
            points = " ".join(f"{x(s):.1f},{y(r[column]):.1f}" for s, r in zip(SAMPLES, rows))
            out.append(f'<polyline points="{points}" fill="none" stroke="{COLOURS[i]}" stroke-width="2"{dash}/>')
    below = 0
    for name in sorted(curves, key=lambda n: -curves[n][-1][0]):
        below = max(below + 16, y(curves[name][-1][0]) + 4)
        colour = COLOURS[list(curves).index(name)]
        out.append(f'<text x="{width - 150}" y="{below:.0f}" fill="{colour}">{name}</text>')
    return "\n".join(out + ["</svg>\n"])


def main():
    logging.getLogger("brume").setLevel(logging.ERROR)
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=SCENES, help="without .toml, from the project's folder")
    parser.add_argument("--size", type=int, default=96, help="width [px]; the height is three quarters of it")
    parser.add_argument("--reference-spp", type=int, default=3072, help="of each of two")
    parser.add_argument("--cache", type=pathlib.Path, default=ROOT / "build/convergence", help="frames that are kept")
    parser.add_argument("--plot", type=pathlib.Path, help="SVG to write")
    options = parser.parse_args()
    options.cache.mkdir(parents=True, exist_ok=True)
    print("| scene | " + " | ".join(f"{s:,} spp" for s in SAMPLES) + " |\n|---|" + "---:|" * len(SAMPLES))
    curves = {}
    for scene in options.scenes:
        name = pathlib.Path(scene).stem.replace("_", " ")
        curves[name] = list(measured(scene, options))
        print(f"| {name} | " + " | ".join(f"{c:.2f}, {n:.2f} ({w}/{of})" for c, n, w, of in curves[name]) + " |", flush=True)
    if options.plot:
        options.plot.write_text(plot(curves))


if __name__ == "__main__":
    main()
