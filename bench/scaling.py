#!/usr/bin/env python3
"""How time and memory grow: whole processes of `brume render VOLUME --clean --spp 8`, from the volume's file to the EXR,
over the volume's size and the picture's. A Markdown table, and with --plot an SVG of it.

    ./run build
    python3 bench/scaling.py --plot docs/images/scaling.svg
"""

import argparse
import os
import pathlib
import subprocess
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
BRUME = ROOT / "build/release/brume"
PICTURES = {"400 x 400": (400, 400), "1920 x 1080": (1920, 1080), "3840 x 2160": (3840, 2160)}
COLOURS = ["#0072b2", "#d55e00", "#009e73"]


def run(*arguments):
    """Seconds and peak memory [GB] of a process with those it starts."""
    start = time.monotonic()
    process = subprocess.Popen([BRUME, *map(str, arguments), "-q"], stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"brume {' '.join(map(str, arguments))} failed")
    return time.monotonic() - start, usage.ru_maxrss * 1024 / 1e9


def plot(rows, edges):
    """Seconds over the volume's edge, both logarithmic, one line for each size of picture."""
    width, height, left, top, right = 640, 380, 60, 20, 130
    times = [seconds for row in rows.values() for seconds, _ in row]
    low, high = min(times) * 0.8, max(times) * 1.25
    from math import log
    x = lambda edge: left + (width - left - right) * log(edge / edges[0]) / log(max(edges[-1] / edges[0], 2))
    y = lambda s: top + (height - top - 50) * log(high / s) / log(high / low)
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="sans-serif" font-size="13">',
           '<rect width="100%" height="100%" fill="white"/>']
    for edge in edges:
        out.append(f'<text x="{x(edge):.0f}" y="{height - 28}" text-anchor="middle">{edge}</text>')
    out.append(f'<text x="{(left + width - right) / 2:.0f}" y="{height - 8}" text-anchor="middle">voxels along the volume</text>')
    out.append(f'<text x="14" y="{top + 4}">s</text>')
    for s in (1, 2, 5, 10, 20, 50, 100, 200):
        if low <= s <= high:
            out.append(f'<line x1="{left}" x2="{width - right}" y1="{y(s):.0f}" y2="{y(s):.0f}" stroke="#ddd"/>'
                       f'<text x="{left - 8}" y="{y(s) + 4:.0f}" text-anchor="end">{s}</text>')
    for (name, row), colour in zip(rows.items(), COLOURS):
        points = " ".join(f"{x(e):.1f},{y(s):.1f}" for e, (s, _) in zip(edges, row))
        out.append(f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="2"/>'
                   f'<text x="{width - right + 8}" y="{y(row[-1][0]) + 4:.0f}" fill="{colour}">{name}</text>')
    return "\n".join(out + ["</svg>\n"])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--edges", type=int, nargs="+", default=[128, 256, 512, 1024], help="voxels along the cloud")
    parser.add_argument("--spp", type=int, default=8)
    parser.add_argument("--folder", type=pathlib.Path, default=ROOT / "build/scaling", help="volumes that are kept")
    parser.add_argument("--plot", type=pathlib.Path, help="SVG to write")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    rows = {name: [] for name in PICTURES}
    print("| voxels along the cloud | " + " | ".join(PICTURES) + " |\n|---:|" + "---:|" * len(PICTURES))
    for edge in options.edges:
        volume = options.folder / f"cloud_{edge}.vdb"
        if not volume.exists():
            run("generate", "cloud", "--resolution", edge, "--half", "-o", volume)
        for name, (width, height) in PICTURES.items():
            rows[name].append(run("render", volume, "--clean", "--spp", options.spp, "-D", f"film.width={width}", "-D",
                                  f"film.height={height}", "-o", options.folder / "clean.exr"))
        print(f"| {edge} | " + " | ".join(f"{row[-1][0]:.1f} s, {row[-1][1]:.2f} GB" for row in rows.values()) + " |", flush=True)
    if options.plot:
        options.plot.write_text(plot(rows, options.edges))


if __name__ == "__main__":
    main()
