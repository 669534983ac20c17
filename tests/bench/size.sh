#!/usr/bin/env bash
# How large the runtime is: the shared library, stripped, whole and with parts left out. Prints the table of results/size.md.
# size.sh [BUILD_FOLDER], a new temporary one if there is none
set -euo pipefail
source=$(cd "$(dirname "$0")/../.." && pwd)
work=${1:-$(mktemp -d)}

# row TEXT OPTION...
row() {
    local text=$1 cells="" type folder library
    shift
    for type in Release MinSizeRel; do
        folder=$work/$(echo "$type $*" | cksum | cut -d' ' -f1)
        rm -f "$folder"/runtime/libnacre_runtime.so*
        cmake -G Ninja -S "$source" -B "$folder" -DCMAKE_BUILD_TYPE=$type -DBUILD_SHARED_LIBS=ON -DNACRE_BUILD_BAKER=OFF -DNACRE_BUILD_TESTS=OFF \
            -DNACRE_BUILD_SAMPLES=OFF "$@" >/dev/null
        cmake --build "$folder" >/dev/null
        library=$(realpath "$folder/runtime/libnacre_runtime.so")
        strip -o "$folder/stripped.so" "$library"
        cells+=" $(($(stat -c %s "$folder/stripped.so") / 1000)) | $(($(gzip -9 -c "$folder/stripped.so" | wc -c) / 1000)) |"
    done
    echo "| $text |$cells"
}

echo "| kB | Release | gzip | MinSizeRel | gzip |"
echo "| --- | --- | --- | --- | --- |"
row "everything"
row "without compute shaders" -DNACRE_WITH_GL43=OFF
row "\`sss\` alone" -DNACRE_WITH_BIGS=OFF
row "\`bigs\` alone" -DNACRE_WITH_SSS=OFF
row "minimal: \`bigs\` without compute shaders" -DNACRE_WITH_SSS=OFF -DNACRE_WITH_GL43=OFF
