#!/usr/bin/env bash
# Datasets on which relighting fails first, photographed by the light stage: the meshes of make_detail_objects.py at 128x128, train 60 cameras
# x 4 lights, test 24 images of other cameras and lights with eight times the samples (fur: four times).
#   tests/bench/make_datasets.sh NACRE OUT [NAME...]        e.g. tests/bench/make_datasets.sh build/baker/nacre /tmp/objects relief_coat_a cloth
# Writes OUT/NAME and OUT/meshes/NAME.glb (the truth of normals and materials, for check_materials); without names, all of them. THREADS=1 in
# the environment keeps to one core. Sets that are complete are skipped, others go on where they were stopped. One to three minutes of one
# core each, fur fifteen. Training images are noisy on purpose (relief_coat_a: some 26 dB over the object, from its noise alone; fur less).
set -euo pipefail
names=(relief_coat_a fur_ball relief_coat_b rough_metal cloth fur_b relief_coat_c roughness_bands thin_parts iridescent)
[ $# -ge 2 ] || { sed -n '2,8s/^# *//p' "$0" >&2; echo "names: ${names[*]}" >&2; exit 2; }
nacre=$1 out=$2; shift 2
[ $# -eq 0 ] || names=("$@")
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)

for name in "${names[@]}"; do
    # Without lamps of any size, light that shiny surfaces throw at each other would be sparkles that no sampling tames: 0.5 blurs it.
    options=(--test-spp 8x --indirect-roughness 0.5)
    case $name in
        relief_coat_a) options+=(--sss "jade:albedo=0.30,0.65,0.38:mfp=0.05,0.08,0.05");;
        relief_coat_c) options+=(--sss "alabaster:albedo=0.82,0.70,0.58:mfp=0.12,0.08,0.06");;
        fur_ball) options=(--test-spp 4x --fur 10000,0.16,0.005);;
        fur_b) options=(--test-spp 4x --fur 12000,0.12,0.005:lean=0.8:clump=0.5);;
    esac
    mesh=$out/meshes/$name.glb
    if [ -e "$out/$name/transforms_train.json" ] && [ -e "$out/$name/transforms_test.json" ]; then
        echo "$name: there already"
        continue
    fi
    [ -e "$mesh" ] || python3 "$here/make_detail_objects.py" "$out/meshes" "$name"
    [ -e "$mesh" ] || { echo "$name: make_detail_objects.py knows no such object" >&2; exit 2; }
    echo "$name: rendering"
    "$nacre" synth "$mesh" -o "$out/$name" --size 128 --cameras 60 --splits train,test --spp 16 --threads "${THREADS:-0}" "${options[@]}"
done
