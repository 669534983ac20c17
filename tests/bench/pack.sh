#!/usr/bin/env bash
# What packing costs on held-out images:  pack.sh NACRE LOSSLESS.glb DATASET OUT "PACK OPTIONS" SPLIT...
# Prints bytes per splat, masked PSNR of the asset as baked (--profile lossless) and packed, and the loss, a line for each split.
set -eu
nacre=$1 asset=$2 dataset=$3 out=$4 options=$5
shift 5
mkdir -p "$out"
# shellcheck disable=SC2086
"$nacre" pack "$asset" -o "$out/packed.glb" --json "$out/pack.json" $options
figure() { sed -n "s/^ *\"$1\": *\([-0-9.e]*\).*/\1/p" "$2" | head -n 1; }
for split in "$@"; do
    for which in baked packed; do
        file=$out/packed.glb
        [ $which = baked ] && file=$asset
        "$nacre" eval "$file" "$dataset" --split "$split" --frames 0 --renderer reference --json "$out/$which.$split.json" >/dev/null
    done
    before=$(figure psnr_masked "$out/baked.$split.json") after=$(figure psnr_masked "$out/packed.$split.json")
    awk -v s="$split" -v b="$(figure bytes_per_splat "$out/packed.$split.json")" -v x="$before" -v y="$after" \
        'BEGIN { printf "%-12s %.1f bytes per splat, %.2f -> %.2f dB, loss %.3f\n", s, b, x, y, x - y }'
done
