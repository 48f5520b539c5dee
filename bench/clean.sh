#!/bin/sh
# Time from nothing to a clean picture against plain path tracing's, in one run on one machine: whole processes, from the
# scene file to the EXR. Path tracing's time and error at 2000 samples per pixel are scaled from SPP samples (64): time in
# proportion to them, loading apart, error with their root.
#
#   bench/clean.sh SCENE [WIDTH HEIGHT [REFERENCE_SPP]]
set -eu
cd "$(dirname "$0")/.."
scene=$1
width=${2:-400} height=${3:-400} reference=${4:-512}
brume=build/release/brume
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
size="-D film.width=$width -D film.height=$height -q"
now() { date +%s.%N; }
# shellcheck disable=SC2086
render() { "$brume" render "$scene" $size "$@" >/dev/null; }
error() {
  "$brume" compare "$1" "$folder/a.exr" --second-reference "$folder/b.exr" --json -q | sed -n 's/.*"lab_rms": *\([0-9.e-]*\).*/\1/p'
}
seconds() { awk -v a="$1" -v b="$2" 'BEGIN {printf "%.2f", b - a}'; }

render --spp "$reference" --seed 101 --no-statistics --layers none -o "$folder/a.exr"
render --spp "$reference" --seed 102 --no-statistics --layers none -o "$folder/b.exr"
spp=${SPP:-64}
start=$(now); render --spp 1 --no-statistics --layers none -o "$folder/load.exr"; loading=$(seconds "$start" "$(now)")
start=$(now); render --spp "$spp" --no-statistics --layers none -o "$folder/traced.exr"; traced=$(seconds "$start" "$(now)")
traced_error=$(error "$folder/traced.exr")
awk -v t="$traced" -v l="$loading" -v n="$spp" -v e="$traced_error" 'BEGIN {
  printf "path tracing, %d spp: %.2f s, Lab RMS %.3f; at 2000 spp: %.1f s, Lab RMS %.3f\n",
         n, t, e, l + (t - l) * 2000 / n, e * sqrt(n / 2000)}' | tee "$folder/traced.txt"
target=$(sed 's/.*Lab RMS //' "$folder/traced.txt")
whole=$(sed 's/.*2000 spp: \([0-9.]*\) s.*/\1/' "$folder/traced.txt")
for spp in 2 4 6 8 12 16 32 64; do
  start=$(now); render --spp $spp --seed 1 --clean -o "$folder/clean.exr"; clean=$(seconds "$start" "$(now)")
  clean_error=$(error "$folder/clean.exr")
  awk -v n=$spp -v t="$clean" -v e="$clean_error" -v w="$whole" -v target="$target" 'BEGIN {
    printf "clean, %d spp: %.2f s, Lab RMS %.3f, 1/%.0f of the time%s\n", n, t, e, w / t, e <= target ? "; as good" : ""}'
  if awk -v e="$clean_error" -v target="$target" 'BEGIN {exit !(e <= target)}'; then break; fi
done
