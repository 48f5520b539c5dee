#!/bin/sh
# Render throughput on two local Slurm nodes of one core each against two bare processes, in pairs taken in turn:
#   bench/farm.sh BRUME [PAIRS] [SPP]
# prints the seconds of each and the ratio bare / Slurm of every pair. Wants a quiet machine and slurm-wlm, munge.
set -eu
cd "$(dirname "$0")/.."
exec /usr/bin/python3 - "$@" <<'PYTHON'
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, "tests/farm")
import slurm_cluster

brume = str(pathlib.Path(sys.argv[1]).resolve())
pairs = int(sys.argv[2]) if len(sys.argv) > 2 else 3
spp = sys.argv[3] if len(sys.argv) > 3 else "256"
scene = str(pathlib.Path("data/scenes/smoke.toml").resolve())
options = ["--spp", spp, "-D", "film.width=200", "-D", "film.height=200", "--layers", "direct,indirect", "--threads", "1"]


def bare(folder):
    """Frames 1 and 3, frames 2 and 4, side by side."""
    folder.mkdir()
    begun = time.monotonic()
    running = [
        subprocess.Popen([brume, "render", scene, "--frames", frames, "-q", "-o", f"{folder}/f.####.exr", *options])
        for frames in ["1,3", "2,4"]
    ]
    for process in running:
        if process.wait() != 0:
            sys.exit("a render failed")
    return time.monotonic() - begun


def on_slurm(cluster, folder):
    begun = time.monotonic()
    words = [brume, "submit", "slurm", scene, "--frames", "1-4", "-q", "--retries", "0", "-o", str(folder), *options]
    subprocess.run(words, env=cluster.environment, check=True, stdout=subprocess.DEVNULL)
    while len(list(folder.glob("frames/smoke.????.exr"))) < 4:
        time.sleep(0.02)
    return time.monotonic() - begun


with tempfile.TemporaryDirectory() as work:
    work = pathlib.Path(work)
    with slurm_cluster.Cluster(work / "slurm") as cluster:
        ratios = []
        for pair in range(pairs):
            seconds = bare(work / f"bare{pair}")
            with_slurm = on_slurm(cluster, work / f"shot{pair}")
            while cluster.queue():
                time.sleep(0.1)
            ratios.append(seconds / with_slurm)
            print(f"pair {pair + 1}: bare {seconds:.1f} s, Slurm {with_slurm:.1f} s, ratio {ratios[-1]:.3f}", flush=True)
        print(f"median ratio {statistics.median(ratios):.3f}")
PYTHON
