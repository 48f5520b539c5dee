#!/bin/sh
# What filters gain from looking through time (docs/sequences.md): sixteen frames of smoke, each filter alone and with as many
# frames on either side as it declares; camera at rest, circling, and panning.
#
#   bench/sequence.sh BRUME FOLDER [FILTER ...]            KINDS="rest circle pan"; oidn needs ./run oidn
set -eu
cd "$(dirname "$0")/.."
brume=$1 folder=$2
shift 2
filters=${*:-transport_regression least_risk oidn nfor nl_means gradient_kernel virtual_flash}
layers=direct,indirect,gradient,gradient_transmittance_weighted,coverage,transmittance,optical_depth,albedo,single,flash,guides
number() { awk "BEGIN { printf \"%.6f\", $1 }"; }

for kind in ${KINDS:-rest circle pan}; do
  mkdir -p "$folder/$kind"
  for frame in $(seq 22 37); do
    position="0,-6,1.15" look="0,0,1.15" x=$(number "0.12 * ($frame - 22)")
    [ $kind = circle ] && position="$x,$(number "-sqrt(36 - $x * $x)"),1.15" look="$(number "0.02 * ($frame - 22)"),0,1.15"
    [ $kind = pan ] && look="$(number "0.25 * ($frame - 29)"),0,1.15"
    render() { "$brume" render bench/scenes/sequence.toml --frames "$frame" -D "camera.position=[$position]" -D "camera.look_at=[$look]" -q "$@" >/dev/null; }
    render --spp 8 --layers $layers -o "$folder/$kind/noisy.####.exr"
    for seed in 101 102; do render --spp 400 --seed $seed --layers coverage --no-statistics -o "$folder/$kind/reference$seed.####.exr"; done
  done
  for filter in $filters; do
    for extra in "--extra-frames 0" ""; do
      # shellcheck disable=SC2086
      "$brume" denoise "$folder/$kind/noisy.####.exr" --frames 22-37 -f "$filter" $extra -o "$folder/$kind/clean.####.exr" -q >/dev/null 2>&1
      echo "$kind, $filter ${extra:-as declared}: whole frame, medium"
      "$brume" compare "$folder/$kind/clean.####.exr" "$folder/$kind/reference101.####.exr" --second-reference "$folder/$kind/reference102.####.exr" \
        --frames 22-37 | grep -E "^(lab_rms|temporal_error|flicker) +[-0-9]"
    done
  done
done
