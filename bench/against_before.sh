#!/bin/sh
# Paths per second of this program and of one built before, in pairs, alternating: the whole process, two threads, default
# layers. Prints for each scene the paths per second of both and the ratio of the fastest runs of each.
#
#   bench/against_before.sh OLD_BRUME [NEW_BRUME]      SCENES="two_volumes ..." SPP=16 PAIRS=4
#
# OLD_BRUME stands beside its brume-vdb-reader.
set -eu
cd "$(dirname "$0")/.."
old=$1
new=${2:-build/release/brume}
spp=${SPP:-16}
pairs=${PAIRS:-4}
folder=$(mktemp -d)
trap 'rm -r "$folder"' EXIT

# Wall time of one render.
seconds() {
  begin=$(date +%s.%N)
  "$1" render "$2" --spp "$spp" --threads 2 -o "$folder/frame.exr" --quiet >/dev/null
  date +%s.%N | awk -v b="$begin" '{printf "%.3f\n", $1 - b}'
}

for name in ${SCENES:-two_volumes floor_and_balls fire_room motion fog_and_spot coloured_cloud}; do
  scene=bench/scenes/general/$name.toml
  [ -f "$scene" ] || scene=bench/scenes/$name.toml
  [ -f "$scene" ] || scene=data/scenes/$name.toml
  : >"$folder/old"
  : >"$folder/new"
  for _ in $(seq "$pairs"); do
    seconds "$old" "$scene" >>"$folder/old"
    seconds "$new" "$scene" >>"$folder/new"
  done
  size=$(sed -n 's/^\(width\|height\) = //p' "$scene" | awk 'BEGIN {n = 1} {n *= $1} END {print n}')
  awk -v old="$(sort -n "$folder/old" | head -1)" -v new="$(sort -n "$folder/new" | head -1)" -v paths="$((size * spp))" \
    -v name="$name" 'BEGIN {printf "%-16s before %.3g paths/s, now %.3g paths/s: %.2f times\n", name, paths / old, paths / new, old / new}'
done
