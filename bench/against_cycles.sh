#!/bin/sh
# brume against Blender's Cycles on the same pictures, in one run on one machine: needs the package blender. Cycles renders
# two seeds of each; its time is what bpy.ops.render takes, loading left out. These scenes need the reference scenes beside
# the project and are left out where those are not there. After them scenes of several media, colours, meshes and fire, which are
# in the clone, by processor time, four seeds and 64 bounces in both.
#
#   bench/against_cycles.sh [FOLDER FOR CYCLES' FRAMES]      SCENES="cloud ..." GENERAL="general/two_volumes ..." SPP=64
set -eu
cd "$(dirname "$0")/.."
references=../shared/references/cycles
folder=${1:-build/cycles}
mkdir -p "$folder"
command -v blender >/dev/null || { echo "needs Blender: apt-get install blender" >&2; exit 1; }
scenes=${SCENES-cloud smoke_plume}
if [ ! -d $references ]; then
  [ -z "$scenes" ] || echo "left out: $scenes, whose reference scenes are no part of the project ($references)" >&2
  scenes=""
fi
for scene in $scenes; do
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
for scene in ${GENERAL-general/two_volumes general/floor_and_balls general/coloured_cloud cycles_explosion cycles_fire_room}; do
  file=bench/scenes/$scene.toml
  scene=${scene#general/}
  frames=""
  seconds=0
  for seed in 1 2 3 4; do
    frame=$folder/${scene}_$seed.exr
    log=$folder/${scene}_$seed.log
    blender -b --factory-startup --python bench/cycles_scene.py -- "$file" "$frame" "${SPP:-64}" $seed >"$log" 2>&1
    rendered=$(sed -n 's/^RENDERED.* cpu //p' "$log")
    seconds=$(awk -v s=$seconds -v r="$rendered" 'BEGIN {print s + r / 4}')
    frames="$frames $frame"
  done
  echo "Cycles, processor time:"
  # shellcheck disable=SC2086
  build/release/bench/brume_efficiency "$file" -D render.max_events=64 --frames $frames --seconds "$seconds"
  echo "brume, processor time:"
  build/release/bench/brume_efficiency "$file" -D render.max_events=64 --spp "${SPP:-64}" --processor-time
done
