#!/usr/bin/env bash
# Packs what a machine with a GPU and nothing of ours installed needs to run every GPU check, the built programs and their libraries, into one
# folder under 60 MB. There: FOLDER/run.sh.
#   tests/gpu/bundle.sh [OUT_DIR] [BUILD_DIR] [DATASET]...      default build/gpu_bundle and build, made with -DNACRE_BUILD_BENCH=ON
# Each DATASET (a folder, a few MB) is baked there on the card and on the CPU.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
build=$(realpath "${2:-$root/build}")
out=${1:-$build/gpu_bundle}
shift $(($# < 2 ? $# : 2))

programs=(tests/test_runtime tests/test_gpu tests/bench_scene tests/bench_device baker/nacre)
for program in "${programs[@]}"; do
    [ -x "$build/$program" ] && continue
    echo "bundle.sh: there is no $build/$program; build with: cmake --preset release -DNACRE_BUILD_BENCH=ON && cmake --build build" >&2
    exit 2
done

rm -rf "$out"
mkdir -p "$out/bin" "$out/lib"
for program in "${programs[@]}"; do
    strip -o "$out/bin/$(basename "$program")" "$build/$program"
done
cp "$root/tests/gpu/run.sh" "$out/"
for dataset in "$@"; do mkdir -p "$out/data" && cp -rL "$dataset" "$out/data/"; done

# Libraries of ours and the loader of GL's drivers, with all that they load. libc goes into a folder of its own: it is used where the other
# machine's is older.
mkdir "$out/libc"
for program in "$out"/bin/*; do ldd "$program"; done | awk '$3 ~ /^\// { print $3 } $1 ~ /^\// { print $1 }' | sort -u | while read -r library; do
    case $(basename "$library") in
        ld-linux-*|libc.so.*|libm.so.*|libpthread.so.*|libdl.so.*|librt.so.*) cp -L "$library" "$out/libc/" ;;
        *) cp -L "$library" "$out/lib/" ;;
    esac
done
tar -C "$out" -czf "$out/programs.tar.gz" bin lib libc
rm -rf "$out/bin" "$out/lib" "$out/libc"
size=$(du -sm "$out" | cut -f1)
echo "$out: $size MB"
[ "$size" -lt 60 ] || { echo "bundle.sh: more than 60 MB" >&2; exit 1; }
