#!/bin/sh
# Checks every dataset below FOLDER: it loads, its convention checks stay silent, and variants of one capture (NAME, NAME_plpos,
# NAME_sssgs) agree in numbers (compare_datasets.cpp). Not part of ctest: the data is not in the repository.
#
#   tests/bench/check_conventions.sh BUILD FOLDER      BUILD: the build folder, configured with -DNACRE_BUILD_BENCH=ON
set -eu
[ $# -eq 2 ] || { echo "usage: $0 BUILD FOLDER" >&2; exit 2; }
build=$1
folder=$2
failures=0
datasets=0

for dataset in "$folder"/*/; do
    dataset=${dataset%/}
    datasets=$((datasets + 1))
    if info=$("$build/baker/nacre" info "$dataset"); then
        suspicions=$(echo "$info" | grep '^warning: ' | grep -v -e 'is a convention, not a measurement' -e 'left out' || true)
        [ -z "$suspicions" ] || { echo "FAILED  $dataset: $suspicions"; failures=$((failures + 1)); }
    else
        echo "FAILED  $dataset does not load"
        failures=$((failures + 1))
        continue
    fi
    base=${dataset%_plpos}
    base=${base%_sssgs}
    [ "$base" = "$dataset" ] || [ ! -d "$base" ] || "$build/tests/compare_datasets" "$base" "$dataset" || failures=$((failures + 1))
done
[ $datasets -gt 0 ] || { echo "FAILED  no dataset in $folder"; exit 1; }
echo "$datasets datasets, $failures failures"
[ $failures -eq 0 ]
