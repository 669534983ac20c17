#!/usr/bin/env bash
# Bakes from simulated captures against bakes from the clean sets of the same cameras and lights, and what they found out about the errors.
#   tests/bench/captures.sh NACRE OUT_DIR MINUTES [stage|phone]...      e.g. tests/bench/captures.sh build/baker/nacre out 10
# Renders the sets of the repository's vase (about 25 minutes of a core; what is there stays), bakes two at a time with a thread each, and prints tables
# for results/captures.md. MODELS="bigs sss" bakes both; VIEWS=80 PIXELS=128 makes the phone's set small; BAKE="--refine-poses=off" adds options.
set -euo pipefail
nacre=$(realpath "$1") out=$2 minutes=$3
shift 3
kinds=${*:-stage phone}
here=$(cd "$(dirname "$0")" && pwd)
mesh=$here/../../samples/assets/vase.glb
pixels=${PIXELS:-192}
mkdir -p "$out"

# Captures are noisy anyway: few samples; what is measured against and the clean sets get more.
set_of() { # kind [clean]
    local options=(--size "$pixels" --splits train,test --test-spp 128 --threads 1 --spp $([ -n "${2:-}" ] && echo 32 || echo 16))
    if [ "$1" = stage ]; then options+=(--cameras 48 --lights 24); else options+=(--cameras "${VIEWS:-500}"); fi
    "$nacre" synth "$mesh" -o "$out/$1${2:+_$2}" --capture "$1${2:+:$2}" "${options[@]}" > "$out/$1${2:+_$2}.synth.log" 2>&1
}

one() { # set model
    local name=$1_$2 asset=$out/$1_$2.glb
    if [ ! -e "$out/$name.bake.json" ]; then
        "$nacre" bake "$out/$1" -o "$asset" --profile lossless --model "$2" --minutes "$minutes" --threads 1 --restart --json "$out/$name.bake.json" ${BAKE:-} > "$out/$name.log" 2>&1
    fi
    "$nacre" eval "$asset" "$out/$1" --split test --threads 1 --frames 0 --json "$out/$name.test.json" --images "$out/$name" > "$out/$name.txt" 2>&1
}
export -f set_of one
export nacre out minutes here mesh pixels BAKE

for kind in $kinds; do printf '%s\0\0%s\0clean\0' "$kind" "$kind"; done | xargs -0 -n 2 -P 2 bash -c 'set_of "$@"' set_of
for kind in $kinds; do
    for model in ${MODELS:-bigs}; do printf '%s\0%s\0%s\0%s\0' "$kind" "$model" "${kind}_clean" "$model"; done
done | xargs -0 -n 2 -P 2 bash -c 'one "$@"' one

for kind in $kinds; do
    for model in ${MODELS:-bigs}; do
        echo
        echo "$kind, $model, $minutes minutes of a core:"
        echo
        echo "| held out | clean set | capture | lost |"
        echo "|---|---|---|---|"
        python3 - "$out/${kind}_clean_$model.test.json" "$out/${kind}_$model.test.json" <<'PY'
import json, sys
clean, capture = (json.load(open(path)) for path in sys.argv[1:3])
for key, name in (("psnr_masked", "PSNR, masked"), ("psnr", "PSNR"), ("ssim", "SSIM")):
    print("| %s | %.3f | %.3f | %.3f |" % (name, clean[key], capture[key], clean[key] - capture[key]))
PY
        echo
        echo "| error | stated | left |"
        echo "|---|---|---|"
        python3 "$here/check_capture.py" "$out/$kind" "$out/${kind}_$model.bake.json"
    done
done
