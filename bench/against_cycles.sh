#!/bin/sh
# brume against Blender's Cycles on the same pictures, in one run on one machine: needs the package blender and the reference
# scenes beside the project. Cycles renders two seeds of each; its wall time is what bpy.ops.render takes, loading left out.
#
#   bench/against_cycles.sh [FOLDER FOR CYCLES' FRAMES]
set -eu
cd "$(dirname "$0")/.."
references=../shared/references/cycles
folder=${1:-build/cycles}
mkdir -p "$folder"
[ -d $references ] || { echo "needs the reference scenes in $references, which are no part of the project" >&2; exit 1; }
command -v blender >/dev/null || { echo "needs Blender: apt-get install blender" >&2; exit 1; }
for scene in ${SCENES:-cloud smoke_plume}; do
  name=cycles_${scene%_plume}
  seconds=0
  for seed in 1 2; do
    frame=$folder/${scene}_$seed.exr
    log=$folder/${scene}_$seed.log
    blender -b --factory-startup --python $references/render_cycles.py -- $references/$scene.json "$frame" spp=16 seed=$seed >"$log" 2>&1
    rendered=$(sed -n 's/^RENDERED.* seconds \([0-9.]*\) cpu.*/\1/p' "$log")
    seconds=$(awk -v s=$seconds -v r="$rendered" 'BEGIN {print s + r / 2}')
  done
  echo "Cycles:"
  build/release/bench/brume_efficiency bench/scenes/$name.toml --frames "$folder/${scene}_1.exr" "$folder/${scene}_2.exr" --seconds "$seconds"
  echo "brume:"
  build/release/bench/brume_efficiency bench/scenes/$name.toml
done
