#!/usr/bin/env bash
# Held-out quality of a bake on an OLAT set with the splits test, near, directional (and environment), and parity of the two renderers.
#   tests/bench/quality.sh DATASET OUT_DIR [MINUTES]        e.g. tests/bench/quality.sh data/bunny_wax /tmp/bunny 10
# Needs a build with -DNACRE_BUILD_BENCH=ON in build/. Prints one table; keeps assets, JSON and contact sheets in OUT_DIR.
set -euo pipefail
dataset=$1 out=$2 minutes=${3:-10}
here=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
nacre=$here/build/baker/nacre
mkdir -p "$out"

"$nacre" bake "$dataset" -o "$out/asset.glb" --profile lossless --model bigs --minutes "$minutes" --json "$out/bake.json"
for split in test near directional environment; do
    "$nacre" eval "$out/asset.glb" "$dataset" --split "$split" --json "$out/$split.json" --images "$out/$split" > "$out/$split.txt" || continue
    printf '%-12s %s\n' "$split" "$(grep -E '^ *mean' "$out/$split.txt")"
done
"$nacre" eval "$out/asset.glb" "$dataset" --split test --renderer reference --json "$out/reference.json" --images "$out/reference" > "$out/reference.txt"
printf '%-12s %s\n' "reference" "$(grep -E '^ *mean' "$out/reference.txt")"
echo "GL against reference renderer: $("$here/build/tests/compare_renders" "$out/test" "$out/reference" | tail -n 1)"
tail -n 2 "$out/test.txt"
