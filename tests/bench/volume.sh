#!/usr/bin/env bash
# A capture of the papers' size, made of few pictures: cameras x lights images of 800 x 800 (default 100 x 112), hard links of what the light stage
# renders once, each with a description of its own. What they show does not matter here, their number does.
#   tests/bench/volume.sh NACRE MESH.glb OUT [CAMERAS] [LIGHTS] [THREADS]
# Measures: nacre prepare, killed (kill -9) on the way and completed, in ms of CPU an image; bakes of the packed set with --memory 4 and of a part of it
# that stays in memory, in images a second after the start; a bake that is killed and resumed; peak memory. Needs 2.2 MB of disk an image. Writes OUT/volume.md.
set -euo pipefail
[ $# -ge 3 ] || { sed -n '2,7s/^# *//p' "$0" >&2; exit 2; }
nacre=$1 mesh=$2 out=$3 cameras=${4:-100} lights=${5:-112} threads=${6:-1}
first=${VOLUME_STEPS:-40} second=${VOLUME_MORE_STEPS:-120} # steps of the shorter and the longer bake, whose difference is timed
mkdir -p "$out"

[ -e "$out/rendered/transforms_train.json" ] ||
    "$nacre" synth "$mesh" -o "$out/rendered" --cameras 10 --lights-per-camera 2 --size 800 --spp 16 --splits train --convention sssgs --threads "$threads" >"$out/log.txt" 2>&1
rm -rf "$out/set" "$out/part" "$out/packed" "$out/packed.part" "$out"/*.glb*
python3 - "$out" "$cameras" "$lights" <<'PY'
import json, math, os, sys
out, cameras, lights = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
rendered = json.load(open(f"{out}/rendered/transforms_train.json"))
frames = rendered["frames"]
os.makedirs(f"{out}/set/train")
os.makedirs(f"{out}/part")
os.symlink("../set/train", f"{out}/part/train")
def frame(c, lights):
    base = frames[c % len(frames)]
    pose = [list(row) for row in base["transform_matrix"]]
    pose[0][3] += 1e-3 * (c // len(frames))  # a camera of its own
    paths, positions = [], []
    for l in range(lights):
        source = base["file_paths"][l % len(base["file_paths"])]
        name = f"train/{c:04d}_{l:03d}"
        if not os.path.exists(f"{out}/set/{name}.png"): os.link(f"{out}/rendered/{source}.png", f"{out}/set/{name}.png")
        angle, height = 2.4 * l, 0.2 + 0.8 * (l + 0.5) / lights
        near = base["light_positions"][l % len(base["file_paths"])] if l < len(base["file_paths"]) else None
        positions.append(near or [5 * math.cos(angle) * math.sqrt(1 - height * height), 5 * math.sin(angle) * math.sqrt(1 - height * height), 5 * height])
        paths.append(name)
    return {"transform_matrix": pose, "width": base["width"], "height": base["height"], "file_paths": paths, "light_positions": positions,
            "light_intensities": [[1, 1, 1]] * lights}
for name, views, count in (("set", cameras, lights), ("part", min(cameras, 25), min(lights, 4))):
    json.dump({"camera_angle_x": rendered["camera_angle_x"], "frames": [frame(c, count) for c in range(views)]}, open(f"{out}/{name}/transforms_train.json", "w"))
PY
images=$((cameras * lights))

cpu() { # seconds of CPU of a command
    local TIMEFORMAT='%U %S'
    { time "$@" >>"$out/log.txt" 2>&1; } 2>&1 | awk '{ print $1 + $2 }'
}
figure() { python3 -c "import json, sys; print(json.load(open(sys.argv[1]))[sys.argv[2]])" "$@"; }

"$nacre" prepare "$out/set" -o "$out/packed" --threads "$threads" >>"$out/log.txt" 2>&1 &
job=$!
sleep 5
kill -9 $job 2>/dev/null || { echo "too few images: they were prepared before the kill" >&2; exit 2; }
wait $job || true
seconds=$(cpu "$nacre" prepare "$out/set" -o "$out/packed" --threads "$threads" --json "$out/prepare.json")
reused=$(figure "$out/prepare.json" reused)

bake() { "$nacre" bake "$1" -o "$out/$2.glb" --iterations "$3" --memory "$4" --threads "$threads" --profile lossless --restart --json "$out/$2.json" >>"$out/log.txt" 2>&1; }
rate() { # images a second between the shorter and the longer bake
    bake "$1" "$2_short" "$first" "$3"
    bake "$1" "$2" "$second" "$3"
    awk -v a="$(figure "$out/$2_short.json" seconds)" -v b="$(figure "$out/$2.json" seconds)" -v n=$((4 * (second - first))) 'BEGIN { printf "%.2f", n / (b - a) }'
}
packed=$(rate "$out/packed" packed 4)
ram=$(rate "$out/part" ram 64)

"$nacre" bake "$out/packed" -o "$out/killed.glb" --iterations "$second" --memory 4 --threads "$threads" --profile lossless >>"$out/log.txt" 2>&1 &
job=$!
for ((i = 0; i < 600; ++i)); do [ ! -e "$out/killed.glb.ckpt" ] || break; sleep 1; done
kill -9 $job
wait $job || true
"$nacre" bake "$out/packed" -o "$out/killed.glb" --iterations "$second" --memory 4 --threads "$threads" --profile lossless --resume >>"$out/log.txt" 2>&1
same=$(cmp -s "$out/killed.glb" "$out/packed.glb" && echo "the same file" || echo "ANOTHER FILE")

{
    echo "\`tests/bench/volume.sh NACRE $(basename "$mesh") OUT $cameras $lights $threads\` on $(nproc) cores of $(sed -n 's/^model name.*: //p' /proc/cpuinfo | head -1)"
    echo
    echo "| $images images of 800 x 800, $threads thread(s) | |"
    echo "|---|---|"
    awk -v s="$seconds" -v n=$((images - reused)) 'BEGIN { printf "| prepare, CPU an image | %.1f ms |\n", 1000 * s / n }'
    awk -v s="$(figure "$out/prepare.json" seconds)" -v n=$((images - reused)) -v t="$threads" 'BEGIN { printf "| prepare, clock x threads an image | %.1f ms |\n", 1000 * s * t / n }'
    echo "| images kept of the run that was killed | $reused |"
    awk -v b="$(figure "$out/prepare.json" bytes)" -v p="$(figure "$out/prepare.json" peak_rss_bytes)" 'BEGIN { printf "| packed set | %.1f GB |\n| peak memory of prepare | %.0f MB |\n", b / 1e9, p / 1e6 }'
    echo "| images a second, packed set, --memory 4 | $packed |"
    echo "| images a second, 100 of them in memory | $ram |"
    awk -v a="$packed" -v b="$ram" 'BEGIN { printf "| ratio | %.2f |\n", a / b }'
    awk -v p="$(figure "$out/packed.json" peak_rss_bytes)" 'BEGIN { printf "| peak memory, --memory 4 | %.2f GB |\n", p / 1e9 }'
    echo "| killed and resumed against left alone | $same |"
} | tee "$out/volume.md"
