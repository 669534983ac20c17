#!/usr/bin/env bash
# Held-out figures of timed bakes of both models on several OLAT sets, two bakes at a time with a thread each.
#   tests/bench/held_out.sh NACRE OUT_DIR MINUTES DATASET...      e.g. tests/bench/held_out.sh build/baker/nacre out 10 data/bunny_wax data/knob_marble
# MODELS="bigs" bakes only that; BAKE="--without forward" adds options. What is in OUT_DIR already is not baked again. Prints a table of every
# split that a set has; keeps assets, JSON, logs and contact sheets of the test split.
set -euo pipefail
nacre=$(realpath "$1") out=$2 minutes=$3
shift 3
mkdir -p "$out"

one() { # dataset model
    local name=$(basename "$1")_$2
    local asset=$out/$name.glb
    if [ ! -e "$out/$name.baked" ]; then
        "$nacre" bake "$1" -o "$asset" --profile lossless --model "$2" --minutes "$minutes" --threads 1 ${BAKE:-} > "$out/$name.log" 2>&1
        grep -E "iterations in|left out|kept" "$out/$name.log" | tr '\n' ' ' > "$out/$name.baked"
    fi
    for transforms in "$1"/transforms_*.json; do
        local split=${transforms##*transforms_} images=()
        split=${split%.json}
        [ "$split" = train ] && continue
        [ "$split" = test ] && images=(--images "$out/$name")
        "$nacre" eval "$asset" "$1" --split "$split" --threads 1 --frames 0 --json "$out/$name.$split.json" "${images[@]}" > "$out/$name.$split.txt" 2>&1
    done
}
export -f one
export nacre out minutes BAKE

for dataset in "$@"; do
    for model in ${MODELS:-bigs sss}; do printf '%s\0%s\0' "$dataset" "$model"; done
done | xargs -0 -n 2 -P 2 bash -c 'one "$@"' one

echo "| set, model | split | psnr | masked | bright | missing % | false % |"
echo "|---|---|---|---|---|---|---|"
for json in "$out"/*.*.json; do
    python3 -c '
import json, os, sys
f = json.load(open(sys.argv[1]))
name = os.path.basename(sys.argv[1]).rsplit(".", 2)[0]
bright = f["psnr_highlight"]
print("| %s | %s | %.2f | %.2f | %s | %.3f | %.3f |" % (name, f["split"], f["psnr"], f["psnr_masked"], "" if bright is None else "%.2f" % bright,
                                                    100 * f["highlight_missing"], 100 * f["highlight_false"]))' "$json"
done
for log in "$out"/*.baked; do echo "$(basename "$log" .baked): $(cat "$log")"; done
