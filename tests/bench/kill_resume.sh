#!/usr/bin/env bash
# A bake that is killed (kill -9) at ten random moments and goes on with --resume, against the same bake left alone: held-out quality.
#   tests/bench/kill_resume.sh BUILD DATASET OUT [ITERATIONS]       e.g. tests/bench/kill_resume.sh build data/bunny_wax kill_out 5000
# BUILD: the build folder. Keeps both assets and their JSON in OUT. Exit code 1 if they differ by more than 0.1 dB or the killed bake
# does not get to its end, 2 if fewer than ten kills hit a running bake: then it is too short, give more ITERATIONS.
set -euo pipefail
[ $# -ge 3 ] || { sed -n '2,5s/^# *//p' "$0" >&2; exit 2; }
nacre=$1/baker/nacre dataset=$2 out=$3 iterations=${4:-3000}
kills=10 limit=0.1
mkdir -p "$out"
rm -f "$out"/{whole,killed}.glb*

bake() { "$nacre" bake "$dataset" --profile lossless "$@" >>"$out/log.txt" 2>&1; }
seconds() { # of a command, on the clock
    local from=$EPOCHREALTIME
    "$@" || { echo "FAILED: $* (see $out/log.txt)" >&2; return 1; }
    awk -v a="$from" -v b="$EPOCHREALTIME" 'BEGIN { print b - a }'
}
: >"$out/log.txt"
start=$(seconds bake -o "$out/start.glb" --iterations 1) # loading and the visual hull, which every start repeats
whole=$(seconds bake -o "$out/whole.glb" --iterations "$iterations")
rm "$out/start.glb"

# Of ten stretches of training, together 0.85 of the bake, each 0.5 to 1.5 times as long as their mean: the same ones in every run. Every
# kill takes the bake back to its last checkpoint, so that the tenth comes somewhat before the end.
moments=$(awk -v n=$kills -v start="$start" -v whole="$whole" 'BEGIN {
    srand(4); for (i = 0; i < n; ++i) sum += length_[i] = 0.5 + rand()
    for (i = 0; i < n; ++i) printf "%.3f ", start + 0.85 * (whole - start) * length_[i] / sum }')
printf 'start %.1f s, whole bake %.1f s, killed after (s): %s\n' "$start" "$whole" "$moments"

done_kills=0 anew=0
goOn() { [ -e "$out/killed.glb.ckpt" ] && echo --resume || true; } # a kill before the first checkpoint: start again
for moment in $moments; do
    resume=$(goOn)
    [ -n "$resume" ] || anew=$((anew + 1))
    "$nacre" bake "$dataset" --profile lossless -o "$out/killed.glb" --iterations "$iterations" $resume >>"$out/log.txt" 2>&1 &
    job=$!
    sleep "$moment"
    kill -9 $job 2>/dev/null || true
    code=0
    { wait $job; } 2>/dev/null || code=$?
    case $code in
        137) done_kills=$((done_kills + 1)) ;;
        0) break ;;
        *) echo "FAILED: exit code $code after $done_kills kills (see $out/log.txt)"; exit 1 ;;
    esac
done
echo "$done_kills kills, $anew starts without a checkpoint"
[ -e "$out/killed.glb" ] || seconds bake -o "$out/killed.glb" --iterations "$iterations" $(goOn) >/dev/null || exit 1
left=$(find "$out" -name 'killed.glb.*')
[ -z "$left" ] || { echo "FAILED: left behind: $left"; exit 1; }

for asset in whole killed; do
    "$nacre" eval "$out/$asset.glb" "$dataset" --split test --renderer reference --json "$out/$asset.json" >>"$out/log.txt" 2>&1 ||
        { echo "FAILED: eval of $out/$asset.glb (see $out/log.txt)"; exit 1; }
done
figure() { sed -n "s/^ *\"$2\": *\([-0-9.e+]*\).*/\1/p" "$out/$1.json"; }
cmp -s "$out/whole.glb" "$out/killed.glb" && echo "the assets are the same, byte for byte" || echo "the assets differ"
for name in psnr psnr_masked; do echo "$name $(figure whole $name) $(figure killed $name)"; done | awk -v limit=$limit '
    NF != 3 { print "FAILED: no figure " $0; bad = 1; next }
    { d = $3 - $2; printf "%-12s left alone %.3f dB, killed %.3f dB, difference %+.3f dB\n", $1, $2, $3, d; if (d > limit || d < -limit) bad = 1 }
    END { exit bad }' || { echo "FAILED: more than $limit dB apart"; exit 1; }
[ $done_kills = $kills ] || { echo "only $done_kills of $kills kills hit a running bake: give more iterations" >&2; exit 2; }
