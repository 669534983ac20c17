#!/usr/bin/env bash
# From nothing to relit pictures: builds Nacre, bakes the embedded sample, compares it with held-out images and circles a light
# around it. Leaves everything in demo-out/. A second run keeps the build and the asset; delete demo-out/ to bake again.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

dataset=samples/data/bunny_wax_tiny
out=demo-out
nacre=build/baker/nacre

tests/packages.sh
echo "== build"
cmake --preset release
cmake --build build --target nacre
mkdir -p "$out/frames"

if [ -s "$out/bunny.glb" ] && [ -s "$out/bake.json" ]; then
    echo "== bake: $out/bunny.glb is there already (delete $out to bake again)"
else
    echo "== bake: about 1.5 minutes"
    "$nacre" bake "$dataset" -o "$out/bunny.glb" --minutes 1.5 --max-splats 5000 --json "$out/bake.json"
fi

echo "== compare with held-out cameras and lights"
"$nacre" eval "$out/bunny.glb" "$dataset" --split test --images "$out/sheets" --json "$out/eval.json"

echo "== circle a light around it"
"$nacre" render "$out/bunny.glb" -o "$out/frames/light.png" --camera "$dataset:test:0" --size 256x256 --frames 24

# value KEY FILE [DIGITS]: a number or a string of a JSON file as nacre writes it, one key a line
value() {
    local text
    text=$(sed -n "s/^  \"$1\": \"\{0,1\}\([^\"]*[^\",]\)\"\{0,1\},\{0,1\}\$/\1/p" "$2")
    if [ $# = 3 ]; then LC_ALL=C printf "%.$3f" "$text"; else printf '%s' "$text"; fi
}
cat > "$out/summary.txt" <<END
sample            $dataset
held-out images   $(value images "$out/eval.json") (cameras and lights that training never saw)
PSNR              $(value psnr "$out/eval.json" 2) dB whole image, $(value psnr_masked "$out/eval.json" 2) dB on the object
SSIM              $(value ssim "$out/eval.json" 4)
bake              $(value seconds "$out/bake.json" 1) s, $(value iterations "$out/bake.json") iterations
splats            $(value splats "$out/eval.json")
asset             $(value asset_bytes "$out/eval.json") bytes, $(value bytes_per_splat "$out/eval.json" 1) per splat
frame             $(value ms_per_frame "$out/eval.json" 1) ms with $(value drawn_by "$out/eval.json")
END
echo "== $out/summary.txt"
cat "$out/summary.txt"
echo "contact sheets (reference | render | 4x error): $out/sheets; frames: $out/frames; asset: $out/bunny.glb"
