#!/usr/bin/env bash
# Held-out error against bake time, with each technique switched off in turn, as SVG: one bake per technique.
#   tests/bench/ablation.sh BUILD DATASET OUT_DIR [ITERATIONS]        e.g. tests/bench/ablation.sh build data/bunny_wax /tmp/ablation 3000
# Curves by seconds are for comparing within this run. Writes OUT_DIR/<variant>.json and OUT_DIR/ablation.svg.
set -euo pipefail
build=$1 dataset=$2 out=$3 iterations=${4:-3000}
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
mkdir -p "$out"
entries=()
variant() { # name label options...
    local name=$1 label=$2; shift 2
    "$build/baker/nacre" bake "$dataset" -o "$out/$name.glb" --profile lossless --iterations "$iterations" --json "$out/$name.json" "$@" > "$out/$name.txt"
    entries+=("$label=$out/$name.json")
    echo "$label: $(grep -o '[a-z]* kept.*\|[a-z]* left out.*' "$out/$name.txt" || true)"
}
variant all "everything"
variant lobe "no highlights (lobe)" --without lobe
variant forward "no light through hairs and leaves" --without forward
variant search "normals of highlights as descent leaves them" --without normal-search
variant visibility "no hard shadows (visibility)" --without visibility
variant sharing "neighbours share nothing (gloss, indirect light)" --without sharing
variant paper "s of the paper, 9 functions, no lobe, no visibility" --without lobe,visibility --s-functions 9
variant adam "plain Adam, one constant rate for the appearance" --without schedule
variant splats "half of the splats" --max-splats 12000
python3 "$here/plot_histories.py" "$out/ablation.svg" "$(basename "$dataset"), $iterations steps" "${entries[@]}"
for entry in "${entries[@]}"; do
    python3 -c 'import json, sys; label, path = sys.argv[1].split("=", 1); h = json.load(open(path))["history"][-1]; print("| %s | %.2f / %.2f | %.0f |" % (label, h["psnr"], h["psnr_masked"], h["seconds"]))' "$entry"
done
