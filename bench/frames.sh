#!/bin/sh
# What reading and writing a frame of another renderer costs, beside OpenImageIO doing the same: a picture of Blender
# Cycles with 30 channels, enlarged and with noise added, goes through `oiiotool IN -o OUT` and `brume denoise`, whose
# time in the filter is taken off. Runs alternate; the least of each counts. Then the peak of memory, in layers of floats.
# Needs oiiotool (openimageio-tools) and GNU time.
#
#   bench/frames.sh FRAME.exr [WIDTH HEIGHT [half|float [RUNS]]]
set -eu
frame=$1 width=${2:-3840} height=${3:-2160} type=${4:-half} runs=${5:-3}
brume=$(dirname "$0")/../build/release/brume
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
oiiotool "$frame" --resize:filter=box "${width}x$height" --noise:type=gaussian:stddev=0.05:seed=1 \
  --cut "${width}x$height+0+0" --compression zip -d "$type" -o "$folder/in.exr"
now() { date +%s.%N; }
seconds() { awk -v a="$1" -v b="$2" 'BEGIN {printf "%.2f", b - a}'; }
least() { sort -g | head -n 1; }
for _ in $(seq "$runs"); do
  start=$(now); oiiotool "$folder/in.exr" -o "$folder/copy.exr"; seconds "$start" "$(now)" >>"$folder/theirs"
  echo >>"$folder/theirs"
  start=$(now)
  /usr/bin/time -f '%M' -o "$folder/memory" "$brume" denoise "$folder/in.exr" -f gaussian -o "$folder/out.exr" \
    --progress none >/dev/null 2>"$folder/said"
  whole=$(seconds "$start" "$(now)")
  filter=$(sed -n 's/.*(\([0-9.]*\) ms)$/\1/p' "$folder/said")
  awk -v w="$whole" -v f="$filter" 'BEGIN {printf "%.2f\n", w - f / 1000}' >>"$folder/ours"
done
channels=$(oiiotool --info "$folder/in.exr" | sed -n 's/.*, \([0-9]*\) channel.*/\1/p')
awk -v t="$(least <"$folder/theirs")" -v o="$(least <"$folder/ours")" -v m="$(cat "$folder/memory")" \
  -v c="$channels" -v p="$((width * height))" 'BEGIN {
  layers = 4.0 * c * p
  printf "oiiotool %.2f s, brume without its filter %.2f s: ratio %.2f\n", t, o, o / t
  printf "peak %.2f GB, the %d layers as floats %.2f GB: ratio %.2f\n", m * 1024 / 1e9, c, layers / 1e9, m * 1024 / layers}'
