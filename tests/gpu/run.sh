#!/usr/bin/env bash
# Every check that wants a GPU, in one command, under nine minutes. Runs where it lies (tests/gpu/bundle.sh made the folder).
#   run.sh [OUT_DIR]      default results; OUT_DIR/<gpu>.json is for tests/bench/results/
# Ends with 0 if all checks pass, whatever draws; the first lines say whether that is a GPU.
set -uo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
out=${1:-results}
mkdir -p "$out" && out=$(cd "$out" && pwd)

[ -d "$here/bin" ] || tar -C "$here" -xzf "$here/programs.tar.gz"

# The GPU's driver announces itself by a file that a bare machine may lack.
if [ -z "${__EGL_VENDOR_LIBRARY_FILENAMES:-}" ] && ldconfig -p 2>/dev/null | grep -q libEGL_nvidia.so.0 &&
    ! ls /usr/share/glvnd/egl_vendor.d/*nvidia* /etc/glvnd/egl_vendor.d/*nvidia* >/dev/null 2>&1; then
    echo '{"file_format_version": "1.0.0", "ICD": {"library_path": "libEGL_nvidia.so.0"}}' > "$out/nvidia_egl.json"
    export __EGL_VENDOR_LIBRARY_FILENAMES="$out/nvidia_egl.json"
fi

# Our own libc only where the machine's is too old for the programs.
start=(env "LD_LIBRARY_PATH=$here/lib:${LD_LIBRARY_PATH:-}")
if ! "${start[@]}" "$here/bin/test_runtime" --version >/dev/null 2>&1; then
    start=("$here/libc/ld-linux-x86-64.so.2" --library-path "$here/libc:$here/lib:/usr/lib/x86_64-linux-gnu:${LD_LIBRARY_PATH:-}")
fi

failed=0
check() { # name, seconds, command
    local name=$1 seconds=$2
    shift 2
    echo "== $name"
    if timeout "$seconds" "${start[@]}" "$@" > "$out/$name.log" 2>&1; then
        echo "passed"
    else
        echo "FAILED ($?), the end of $out/$name.log:"
        tail -20 "$out/$name.log"
        failed=1
    fi
}

# Bakes on the card against bakes on the CPU: held-out error, time of a step. Without a CUDA card this says so and is no failure: the GL checks stand alone.
for dataset in "$here"/data/*/; do
    [ -d "$dataset" ] || continue
    for model in bigs sss; do
        name=bake_$(basename "$dataset")_$model
        if "${start[@]}" "$here/bin/nacre" bake "$dataset" -o "$out/probe.glb" --device cuda --iterations 1 --model "$model" --profile lossless > "$out/$name.probe.log" 2>&1; then
            check "$name" 100 "$here/bin/bench_device" "$dataset" "$model" 2000 cuda
            cat "$out/$name.log"
        else
            echo "== $name"
            echo "SKIPPED: $(tail -1 "$out/$name.probe.log")"
        fi
        rm -f "$out/probe.glb"
    done
    if command -v compute-sanitizer >/dev/null && [ -s "$out/bake_$(basename "$dataset")_bigs.log" ]; then
        check sanitizer 60 compute-sanitizer --error-exitcode 1 "$here/bin/nacre" bake "$dataset" -o "$out/probe.glb" --device cuda --iterations 20 --profile lossless
        rm -f "$out/probe.glb"
    fi
done

check scenes 150 "$here/bin/bench_scene" 100 "$out/scene.json"
cat "$out/scenes.log"
check compute 120 "$here/bin/test_gpu"
check runtime 240 "$here/bin/test_runtime"
tail -3 "$out/runtime.log"

if [ -f "$out/scene.json" ]; then
    name=$(sed -n 's/.*"renderer": "\([^"(,]*\).*/\1/p' "$out/scene.json" | tr -cs 'A-Za-z0-9' '_' | sed 's/_*$//')
    mv "$out/scene.json" "$out/${name:-unknown}.json"
    echo "results: $out/${name:-unknown}.json"
fi
exit $failed
