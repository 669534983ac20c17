#!/usr/bin/env bash
# The light stage against Blender Cycles: same triangles, cameras, lights; diffuse, glossy, two waxes, and glTF's Fresnel on a sphere.
#   tests/bench/compare_cycles.sh NACRE_BINARY [OUT_DIR]      e.g. tests/bench/compare_cycles.sh build/baker/nacre /tmp/cycles
# Needs Blender 3.4 with Cycles (apt install blender) and numpy in its python. Cycles renders once (about 15 minutes on 2 cores) and
# its images are kept in OUT_DIR; ours are rendered anew. SPP=256 sets our samples. Prints a table, writes OUT_DIR/compare.png.
set -euo pipefail
nacre=$(realpath "$1") out=$(realpath -m "${2:-cycles-comparison}") spp=${SPP:-256}
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)/cycles

if ! command -v blender > /dev/null; then
    echo "SKIPPED: blender is not installed (apt install blender)"
    exit 0
fi
blenderRun() { nice -n 15 blender -b --python-exit-code 1 -P "$@"; }

mkdir -p "$out"
blenderRun "$here/scenes.py" -- "$out" > "$out/scenes.log"
blenderRun "$here/render_cycles.py" -- "$out" > "$out/cycles.log"

rm -rf "$out/nacre" "$out/nacre_again"
while read -r variant sss; do
    for run in nacre nacre_again; do
        seed=$([ $run = nacre ] && echo 1 || echo 2)
        arguments=()
        [ "$sss" = - ] || arguments=(--sss "$sss")
        nice -n 15 "$nacre" synth "$out/$variant.glb" -o "$out/$run/$variant" --like "$out/cycles/$variant" --keep-scale \
            --spp "$spp" --test-spp "$spp" --seed "$seed" "${arguments[@]}" > "$out/$run.log" 2>&1 || { cat "$out/$run.log"; exit 1; }
        grep -h -i "warning" "$out/$run.log" || true
    done
done < "$out/sss.txt"
blenderRun "$here/compare.py" -- "$out" | grep -v -E '^Blender|^$'
