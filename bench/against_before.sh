#!/bin/bash
# Paths per second of this program and of one built before, in pairs, alternating: the whole process, two threads, default
# layers. Prints for each scene the ratio of the fastest runs of each, by wall time and by processor time; the latter says
# more on a machine that does other work, too.
#
#   bench/against_before.sh OLD_BRUME [NEW_BRUME]      SCENES="two_volumes ..." SPP=64 PAIRS=4
#
# OLD_BRUME stands beside its brume-vdb-reader.
set -eu
cd "$(dirname "$0")/.."
old=$1
new=${2:-build/release/brume}
spp=${SPP:-64}
pairs=${PAIRS:-4}
folder=$(mktemp -d)
trap 'rm -r "$folder"' EXIT
TIMEFORMAT='%R %U %S'

# Appends a run's wall and processor seconds to a file.
run() {
  { time "$1" render "$2" -D film.width=240 -D film.height=180 --spp "$spp" --threads 2 -o "$folder/frame.exr" --quiet \
    >/dev/null 2>&1; } 2>&1 | awk '{print $1, $2 + $3}' >>"$3"
}
least() { sort -n -k "$2" "$1" | awk -v k="$2" 'NR == 1 {print $k}'; }

for name in ${SCENES:-two_volumes floor_and_balls fire_room motion fog_and_spot coloured_cloud cloud smoke}; do
  scene=bench/scenes/general/$name.toml
  [ -f "$scene" ] || scene=bench/scenes/$name.toml
  [ -f "$scene" ] || scene=data/scenes/$name.toml
  rm -f "$folder/old" "$folder/new"
  for _ in $(seq "$pairs"); do
    run "$old" "$scene" "$folder/old"
    run "$new" "$scene" "$folder/new"
  done
  awk -v name="$name" -v paths=$((240 * 180 * spp)) -v a="$(least "$folder/old" 1)" -v b="$(least "$folder/new" 1)" \
    -v c="$(least "$folder/old" 2)" -v d="$(least "$folder/new" 2)" 'BEGIN {
      printf "%-16s before %.3g paths/s, now %.3g: %.2f times; by processor time %.2f times\n", name, paths / a, paths / b, a / b, c / d}'
done
