#!/usr/bin/python3
"""F12 with brume, clean, against Cycles on artists' scenes (bench/f12_scene.py): how long Cycles takes to reach the error
that brume's clean picture has. Needs Blender, NumPy and a built brume; prints a table for each, and the ratios.

    bench/f12.py FOLDER [--scenes plume,explosion,...] [--percent 50] [--samples 4,16] [--cycles 16,64] [--reference 512]

Errors are relative, root of the mean of (picture - reference)^2 / (reference^2 + 0.01), each renderer against two pictures
of its own with other random numbers, whose product leaves their noise out. Times are processor seconds of the render
alone, Blender and the program together, from F12 to the picture; Cycles' error falls as the root of its samples, which the
table shows.
"""

import argparse
import os
import re
import subprocess
import sys

import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
SOURCE = os.path.dirname(HERE)
sys.path.insert(0, os.path.join(SOURCE, "apps", "blender", "brume_blender"))
import exr  # noqa: E402

RENDER = """
import os, resource, sys, time
sys.path.insert(0, {addon!r})
import addon_utils, bpy
addon_utils.enable("brume_blender", default_set=True)
scene = bpy.context.scene
render = scene.render
render.engine, render.filepath, render.resolution_percentage = {engine!r}, {path!r}, {percent}
render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR_MULTILAYER", "32"
own = scene.brume
own.samples, own.seed, own.use_clean = {samples}, {seed}, {clean}
cycles = scene.cycles
cycles.samples, cycles.seed = {samples}, {seed}
cycles.use_adaptive_sampling, cycles.use_denoising = False, False
cycles.max_bounces = cycles.volume_bounces = 32

def seconds():
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(u.ru_utime + u.ru_stime for u in used)

before, began = seconds(), time.monotonic()
bpy.ops.render.render(write_still=True)
print(f"RENDERED {{seconds() - before:.2f}} {{time.monotonic() - began:.2f}}")
"""


def rendered(options, engine, samples, seed, clean=False):
    """A picture and its processor seconds; kept in the folder from run to run."""
    name = f"{options.scene}_{engine.lower()}_{options.percent}_{samples}_{seed}{'_clean' if clean else ''}"
    path, log = (os.path.join(options.folder, name + ending) for ending in (".exr", ".log"))
    if not os.path.exists(path):
        text = RENDER.format(
            addon=os.path.join(SOURCE, "apps", "blender"), engine=engine, path=path, percent=options.percent, samples=samples,
            seed=seed, clean=clean,
        )  # fmt: skip
        words = ["blender", "-b", "--factory-startup", options.file, "--python-exit-code", "1", "--python-expr", text]
        environment = {**os.environ, "BRUME_PROGRAM": os.environ.get("BRUME_PROGRAM", os.path.join(SOURCE, "build/release/brume"))}
        told = subprocess.run(words, env=environment, capture_output=True, text=True)
        if told.returncode != 0:
            sys.exit(told.stdout + told.stderr)
        with open(log, "w") as file:
            file.write(told.stdout)
    with open(log) as file:
        used = float(re.search(r"^RENDERED (\S+)", file.read(), re.MULTILINE)[1])
    return exr.read(path).layer("ViewLayer.Combined", "RGB").astype(np.float64), used


def error(picture, references):
    a, b = references
    level = ((a + b) / 2) ** 2 + 0.01
    return float(np.sqrt(np.mean((picture - a) * (picture - b) / level)))


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("folder")
    parser.add_argument("--scenes", default="plume,explosion,sunbeams,glass,puffs")
    parser.add_argument("--percent", type=int, default=50)
    parser.add_argument("--samples", default="4,16")
    parser.add_argument("--cycles", default="16,64")
    parser.add_argument("--reference", type=int, default=512)
    options = parser.parse_args()
    os.makedirs(options.folder, exist_ok=True)
    ratios = [(options.scene, measured(options)) for options.scene in options.scenes.split(",")]
    print("\nCycles takes so many times as long: " + "; ".join(f"{name} {', '.join(f'{r:.1f}' for r in own)}" for name, own in ratios))


def measured(options):
    """A scene's table. @return Cycles' times over brume's, for each number of brume's samples"""
    options.file = os.path.join(options.folder, options.scene + ".blend")
    if not os.path.exists(options.file):
        words = ["blender", "-b", "--factory-startup", "--python-exit-code", "1", "--python", os.path.join(HERE, "f12_scene.py")]
        subprocess.run([*words, "--", options.file, options.scene], check=True, stdout=subprocess.DEVNULL)

    print(f"\n**{options.scene}**\n")
    print("| picture | samples | processor seconds | relative error |\n|---|---:|---:|---:|")
    references = [rendered(options, "CYCLES", options.reference, seed)[0] for seed in (101, 102)]
    curve = []  # of Cycles: samples, seconds, error
    for samples in map(int, options.cycles.split(",")):
        picture, seconds = rendered(options, "CYCLES", samples, 1)
        curve.append((samples, seconds, error(picture, references)))
        print(f"| Cycles | {samples} | {seconds:.1f} | {curve[-1][2]:.4f} |")
    (first, first_seconds, _), (samples, seconds, last_error) = curve[0], curve[-1]
    pace = (seconds - first_seconds) / (samples - first)
    references = [rendered(options, "BRUME", options.reference, seed)[0] for seed in (101, 102)]
    ratios = []
    for own in map(int, options.samples.split(",")):
        picture, own_seconds = rendered(options, "BRUME", own, 1, clean=True)
        own_error = error(picture, references)
        needed = samples * (last_error / own_error) ** 2
        theirs = seconds + pace * (needed - samples)
        print(f"| brume, clean | {own} | {own_seconds:.1f} | {own_error:.4f} |")
        print(f"| Cycles at that error | {needed:.0f} | {theirs:.0f} | {own_error:.4f} | {theirs / own_seconds:.1f} times as long", flush=True)
        ratios.append(theirs / own_seconds)
    return ratios


main()
