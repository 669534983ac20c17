#!/usr/bin/env bash
# A runtime without a model or without compute shaders draws what is left as the whole one does, and refuses by name what is not.
# left_out.sh BUILD_DIR SOURCE_DIR WRITE_ASSETS HELLO_SPLAT
set -euo pipefail
build=$1 source=$2 write_assets=$3 hello=$4
if grep -q '^NACRE_SANITIZE:BOOL=ON' "$build/CMakeCache.txt"; then
    echo "SKIPPED: what the builds below lack is the same without sanitizers"
    exit 0
fi
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
kept=$build/tests/left_out # not optimised, kept so that only the first run takes long
cd "$work"

fail() { echo "FAILED: $*"; exit 1; }
quietly() { "$@" >"$work/log" 2>&1 || { cat "$work/log"; fail "$*"; }; }

# refused TEXT COMMAND...: fails, with one line that contains TEXT
refused() {
    local text=$1
    shift
    "$@" 2>stderr.txt && fail "not refused: $*"
    [ "$(wc -l <stderr.txt)" = 1 ] && grep -qF -- "$text" stderr.txt || { cat stderr.txt; fail "expected one line about '$text': $*"; }
}

# without FOLDER MODEL_LEFT MODEL_LEFT_OUT OPTION...
without() {
    local folder=$kept/$1 left=$2 out=$3
    shift 3
    quietly cmake -G Ninja -S "$source" -B "$folder" -DCMAKE_BUILD_TYPE=None -DNACRE_BUILD_BAKER=OFF -DNACRE_BUILD_TESTS=OFF -DNACRE_BUILD_SAMPLES=ON "$@"
    quietly cmake --build "$folder" --target hello_splat
    quietly "$folder/samples/hello_splat" "$left.glb" part.ppm
    cmp "$left.ppm" part.ppm || fail "another picture of $left.glb $*"
    refused "'$out' was left out of this build" "$folder/samples/hello_splat" "$out.glb" part.ppm
}

quietly "$write_assets" .
for model in bigs sss; do quietly "$hello" $model.glb $model.ppm; done
without minimal bigs sss -DNACRE_WITH_SSS=OFF -DNACRE_WITH_GL43=OFF
without no_bigs sss bigs -DNACRE_WITH_BIGS=OFF

# the sample again, but it asks for compute shaders
sed 's/\.getProcAddress = getProcAddress,/& .backEnd = NACRE_BACK_END_GL43,/' "$source/samples/hello_splat/hello_splat.c" >wants.c
quietly cc -std=gnu99 -I"$source/runtime/include" wants.c "$kept/minimal/runtime/libnacre_runtime.a" -lEGL -lOpenGL -lstdc++ -lm -o wants
refused "NACRE_BACK_END_GL43 was left out of this build" ./wants bigs.glb part.ppm

echo "all checks passed"
