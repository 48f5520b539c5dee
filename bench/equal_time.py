#!/usr/bin/env python3
"""Error over processor seconds: path tracing alone, with the best filter without guides, with Open Image Denoise where
`./run oidn` has fetched its weights, and `--clean`.

    bench/equal_time.py -o build/equal_time

Of each scene one run of `brume render` on one thread for each method and count of samples: its processor seconds, loading and
writing included, and the Lab RMS over the whole frame to two references, whose noise is taken off. Every rival gets as many
samples as the seconds of `--clean` buy. Prints the factors in error at equal time and in time to equal error, by straight lines
between the measured points in logarithms of both; writes table.md, results.json and curves.svg. What is measured is kept.
"""

import argparse
import json
import math
import os
import pathlib
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
GENERAL = ["floor_and_balls", "behind_glass", "inside_cloud", "fog_and_spot", "coloured_cloud", "motion", "two_volumes",
           "lamp_inside", "droplets", "lens", "cloud_in_haze", "fire_room"]
MEDIA = ["data/scenes/cloud", "data/scenes/smoke", "data/scenes/fire", "bench/scenes/forward_cloud",
         "bench/scenes/coloured_smoke", "bench/scenes/solid_smoke"]
ROOMS = ["bench/scenes/kinds/dusty_room", "bench/scenes/kinds/lamp_room"]
SCENES = MEDIA + [f"bench/scenes/general/{s}" for s in GENERAL] + ROOMS

# What is run for each, and the line that it belongs to. A rival's render records the features that its filter can use, and
# nothing else; Open Image Denoise is tried without them, too, which is cheaper.
CLEAN, TRACED, FILTERED, LEARNED = "--clean", "path tracing", "best filter without guides", "Open Image Denoise"
METHODS = [(CLEAN, ["--clean"]), (TRACED, ["--no-statistics"])]
METHODS += [(FILTERED, ["--clean-filter", f]) for f in ("sbf", "nfor", "least_risk:network=none")]
METHODS += [(LEARNED, ["--clean-filter", f"oidn:quality={q},mode={m}"]) for q in ("high", "fast") for m in ("auto", "color")]
COLOURS = {CLEAN: "#0072b2", TRACED: "#888888", FILTERED: "#009e73", LEARNED: "#d55e00"}
JUDGED = [4, 16]  # samples of --clean at whose seconds methods are compared
CLEAN_SAMPLES = [1, 2, 4, 8, 16, 64]
MOST_SAMPLES = 4096


class Bench:
    def __init__(self, options):
        self.options, self.program = options, str(ROOT / "build/release/brume")
        self.kept = options.output / "measured.json"
        self.measured = json.loads(self.kept.read_text()) if self.kept.exists() else {}

    def render(self, scene, path, spp, seed, arguments):
        """Processor seconds of the program and what it starts."""
        width = self.options.size
        command = [self.program, "render", str(ROOT / f"{scene}.toml"), "--spp", str(spp), "--seed", str(seed), "--threads", "1",
                   "-q", "-o", str(path)] + arguments + ([] if arguments == ["--clean"] else ["--layers", "none"])
        if width:
            command += ["-D", f"film.width={width}", "-D", f"film.height={width * 3 // 4}"]
        before = os.times()
        run = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        after = os.times()
        if run.returncode:
            sys.exit(f"{' '.join(command)}\n{run.stderr}")
        return after.children_user + after.children_system - before.children_user - before.children_system

    def references(self, scene):
        paths = []
        for seed in (101, 102):
            path = self.options.output / f"{pathlib.Path(scene).stem}_{self.options.size}_{self.options.reference_spp}_{seed}.exr"
            if not path.exists():
                half = path.with_suffix(".part.exr")
                self.render(scene, half, self.options.reference_spp, seed, ["--no-statistics"])
                half.rename(path)
            paths.append(str(path))
        return paths

    def point(self, scene, arguments, spp):
        """Processor seconds and Lab RMS: the mean over seeds."""
        points = []
        for seed in range(1, self.options.seeds + 1):
            key = " ".join([scene, str(self.options.size), str(spp), str(seed)] + arguments)
            if key not in self.measured:
                frame = self.options.output / "frame.exr"
                seconds = self.render(scene, frame, spp, seed, arguments)
                a, b = self.references(scene)
                found = subprocess.run([self.program, "compare", str(frame), a, "--second-reference", b, "--json"],
                                       check=True, stdout=subprocess.PIPE, text=True)
                frame.unlink()
                self.measured[key] = [seconds, max(json.loads(found.stdout)["metrics"]["lab_rms"], 1e-3)]
                self.kept.write_text(json.dumps(self.measured, indent=0))
            points.append(self.measured[key])
        return [sum(p[i] for p in points) / len(points) for i in (0, 1)]

    def curves(self, scene):
        """{line: {label: [[samples, seconds, error], ...]}}"""
        lines = {}
        dearest = 0
        for line, arguments in self.options.methods:
            points = []
            first = 1 if "nfor" in arguments else 0  # it needs two halves
            counts = CLEAN_SAMPLES if line == CLEAN else (2**i for i in range(first, 20))
            for spp in counts:
                points.append([spp] + self.point(scene, arguments, spp))
                if line == CLEAN:
                    if spp == JUDGED[-1]:
                        dearest = points[-1][1]
                elif points[-1][1] > dearest or spp >= MOST_SAMPLES:
                    break
            lines.setdefault(line, {})[" ".join(arguments)] = points
        return lines


def error_at(points, seconds):
    """Where a straight line between two points in logarithms is at these seconds; none before the first point."""
    if seconds < points[0][1]:
        return math.inf
    for (_, s, e), (_, t, f) in zip(points, points[1:]):
        if seconds <= t:
            share = math.log(seconds / s) / math.log(t / s) if t > s else 1
            return math.exp((1 - share) * math.log(e) + share * math.log(f))
    return points[-1][2] * (points[-1][1] / seconds) ** 0.5  # not measured so far: as path tracing converges


def seconds_to(points, error):
    """The least seconds at which it is no larger; beyond the last point as path tracing converges."""
    for i, (_, t, f) in enumerate(points):
        if f <= error:
            if i == 0:
                return t
            _, s, e = points[i - 1]
            share = math.log(e / error) / math.log(e / f)
            return math.exp((1 - share) * math.log(s) + share * math.log(t))
    return points[-1][1] * (points[-1][2] / error) ** 2


def geometric_mean(values):
    return math.exp(sum(map(math.log, values)) / len(values))


def factors(lines):
    """{samples of --clean: {line: (error of clean over the line's in the same time, its seconds over clean's)}}"""
    clean = lines[CLEAN]["--clean"]
    found = {}
    for spp in JUDGED:
        seconds, error = next((s, e) for n, s, e in clean if n == spp)
        found[spp] = {line: (error / min(error_at(p, seconds) for p in methods.values()),
                             min(seconds_to(p, error) for p in methods.values()) / seconds)
                      for line, methods in lines.items() if line != CLEAN}
    return found


def table(results):
    rivals = [line for line in COLOURS if line != CLEAN and any(line in r["lines"] for r in results.values())]
    out = []
    for spp in JUDGED:
        out += [f"`--clean --spp {spp}`: error over that of others in the same processor time; in brackets, how many times as long "
                "they take to its error", "",
                "| scene | s, raw | s, clean | Lab RMS | " + " | ".join(rivals) + " | best |",
                "|---|---:|---:|---:|" + "---:|" * (len(rivals) + 1)]
        best = []
        for scene, result in results.items():
            clean = next(p for p in result["lines"][CLEAN]["--clean"] if p[0] == spp)
            raw = next((p for p in next(iter(result["lines"][TRACED].values())) if p[0] == spp), [0, math.nan])
            at = result["factors"][spp]
            best.append(max(at[r][0] for r in rivals if r in at))
            out.append(f"| {pathlib.Path(scene).stem} | {raw[1]:.2f} | {clean[1]:.2f} | {clean[2]:.2f} | "
                       + " | ".join(f"{at[r][0]:.2f} ({at[r][1]:.1f})" if r in at else "" for r in rivals) + f" | {best[-1]:.2f} |")
        means = [geometric_mean([r["factors"][spp][line][0] for r in results.values() if line in r["factors"][spp]]) for line in rivals]
        out += ["| geometric mean | | | | " + " | ".join(f"{m:.2f}" for m in means) + f" | **{geometric_mean(best):.2f}** |", ""]
    return "\n".join(out)


def envelope(methods):
    """The least error of a line's methods at its points' seconds, falling."""
    points = sorted(p for points in methods.values() for p in ((q[1], q[2]) for q in points))
    kept = []
    for seconds, error in points:
        if not kept or error < kept[-1][1]:
            kept.append((seconds, error))
    return kept


def plot(results):
    """A small picture for each scene, error over seconds, both logarithmic."""
    columns, width, height, left, top = 4, 250, 190, 36, 46
    rows = -(-len(results) // columns)
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {columns * width} {rows * height + top}" '
           'font-family="sans-serif" font-size="11">', '<rect width="100%" height="100%" fill="white"/>']
    shown = {line: colour for line, colour in COLOURS.items() if any(line in r["lines"] for r in results.values())}
    for i, (line, colour) in enumerate(shown.items()):
        out.append(f'<line x1="{10 + 210 * i}" x2="{34 + 210 * i}" y1="16" y2="16" stroke="{colour}" stroke-width="2.5"/>'
                   f'<text x="{40 + 210 * i}" y="20">{line}</text>')
    out.append('<text x="10" y="38" fill="#555">Lab RMS over processor seconds</text>')
    for i, (scene, result) in enumerate(results.items()):
        curves = {line: envelope(methods) for line, methods in result["lines"].items()}
        points = [p for curve in curves.values() for p in curve]
        low, high = (math.log10(f(p[0] for p in points)) for f in (min, max))
        least, most = (math.log10(f(p[1] for p in points)) for f in (min, max))
        x0, y0 = i % columns * width + left, i // columns * height + top
        w, h = width - left - 12, height - 44
        x = lambda s: x0 + w * (math.log10(s) - low) / max(1e-9, high - low)
        y = lambda e: y0 + 14 + h * (most - math.log10(e)) / max(1e-9, most - least)
        out.append(f'<text x="{x0}" y="{y0 + 6}" font-weight="bold">{pathlib.Path(scene).stem.replace("_", " ")}</text>')
        ticks = [m * 10**k for k in range(-3, 5) for m in (1, 3)]
        for e in ticks:
            if least <= math.log10(e) <= most:
                out.append(f'<line x1="{x0}" x2="{x0 + w}" y1="{y(e):.1f}" y2="{y(e):.1f}" stroke="#ddd"/>'
                           f'<text x="{x0 - 4}" y="{y(e) + 4:.1f}" text-anchor="end">{e:g}</text>')
        for s in ticks:
            if low <= math.log10(s) <= high:
                out.append(f'<text x="{x(s):.1f}" y="{y0 + h + 28}" text-anchor="middle">{s:g}</text>')
        for line, curve in curves.items():
            places = " ".join(f"{x(s):.1f},{y(e):.1f}" for s, e in curve)
            out.append(f'<polyline points="{places}" fill="none" stroke="{COLOURS[line]}" stroke-width="2"/>')
    return "\n".join(out + ["</svg>\n"])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=SCENES, help="without .toml, from the project's folder; twenty if none is named")
    parser.add_argument("-o", "--output", type=pathlib.Path, default=ROOT / "build/equal_time")
    parser.add_argument("--size", type=int, default=240, help="width [px]; the height is three quarters of it")
    parser.add_argument("--reference-spp", type=int, default=1024, help="of each of two")
    parser.add_argument("--seeds", type=int, default=1)
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    weights = pathlib.Path(os.environ.get("BRUME_OIDN_WEIGHTS", ROOT / "build/oidn"))
    options.methods = [m for m in METHODS if m[0] != LEARNED or weights.exists()]
    if not weights.exists():
        print(f"{LEARNED} is left out: call ./run oidn for its weights", file=sys.stderr)
    bench, results = Bench(options), {}
    for scene in options.scenes:
        lines = bench.curves(scene)
        results[scene] = {"lines": lines, "factors": factors(lines)}
        at = results[scene]["factors"]
        print(pathlib.Path(scene).stem, {n: {k: round(v[0], 2) for k, v in f.items()} for n, f in at.items()}, file=sys.stderr, flush=True)
    (options.output / "results.json").write_text(json.dumps(results, indent=1))
    (options.output / "table.md").write_text(table(results) + "\n")
    (options.output / "curves.svg").write_text(plot(results))
    print(table(results))


if __name__ == "__main__":
    main()
