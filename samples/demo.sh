#!/usr/bin/env bash
# From nothing to relit pictures. Leaves everything in demo-out/; a second run keeps what is there, delete the folder to start again.
#   samples/demo.sh                   bakes the embedded OLAT sample, compares it with held-out images, circles a light around it
#   samples/demo.sh --mesh [MESH.glb] first makes the OLAT images itself, from a mesh (samples/assets/figurine.glb if none is given)
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

nacre=build/baker/nacre
out=demo-out
dataset=samples/data/bunny_wax_tiny
bake_options=(--minutes 1.5 --max-splats 5000)
bake_time="about 1.5 minutes"
mesh=
if [ "${1:-}" = --mesh ]; then
    mesh=${2:-samples/assets/figurine.glb}
    out=demo-out/mesh
    dataset=$out/dataset
    bake_options=(--minutes 2.5)
    bake_time="about 2.5 minutes"
elif [ $# -gt 0 ]; then
    echo "usage: samples/demo.sh [--mesh [MESH.glb]]" >&2
    exit 2
fi

tests/packages.sh
echo "== build"
cmake --preset release
cmake --build build --target nacre
mkdir -p "$out/frames"

if [ -n "$mesh" ]; then
    echo "== light stage: OLAT images of $mesh (one that was begun before is completed)"
    "$nacre" synth "$mesh" -o "$dataset" --cameras 40 --lights-per-camera 4 --size 192 --spp 48 --test-spp 128 \
        --splits train,test --json "$out/synth.json"
fi

if [ -s "$out/asset.glb" ] && [ -s "$out/bake.json" ]; then
    echo "== bake: $out/asset.glb is there already (delete $out to bake again)"
else
    echo "== bake: $bake_time"
    "$nacre" bake "$dataset" -o "$out/asset.glb" "${bake_options[@]}" --json "$out/bake.json"
fi

echo "== compare with held-out cameras and lights"
"$nacre" eval "$out/asset.glb" "$dataset" --split test --images "$out/sheets" --json "$out/eval.json"

echo "== circle a light around it"
"$nacre" render "$out/asset.glb" -o "$out/frames/light.png" --camera "$dataset:test:0" --size 256x256 --frames 24

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
echo "contact sheets (reference | render | 4x error): $out/sheets; frames: $out/frames; asset: $out/asset.glb"
