#!/usr/bin/env bash
# What reports and tuning are worth, on data that is not in the repository:
#   report.sh BUILD OUT_DIR ASSET.glb:DATASET...
# For each asset (with visibility stored or drawn, of any profile): a report twice, and whether points moved by more than their spread; the asset tuned for
# half of its frame time, against splats dropped at random until it is as fast. Needs -DNACRE_BUILD_BENCH=ON. Prints Markdown.
set -eu
build=$1 out=$2
shift 2
mkdir -p "$out"
nacre=$build/baker/nacre
figure() { sed -n "s/^ *\"$1\": *\([-0-9.e]*\).*/\1/p" "$2" | head -n 1; }
evaluated() { "$nacre" eval "$1" "$2" --json "$out/eval.json" >/dev/null; }
echo "| asset | report [s] | points on the front of time (range) | of bytes (range) | points that a re-run moved beyond their range | half of the splats | a quarter |"
echo "|---|---|---|---|---|---|---|"
for pair in "$@"; do
    asset=${pair%%:*} data=${pair#*:}
    name=$(basename "$asset" .glb)
    [ -s "$out/$name.1.json" ] || "$nacre" report "$asset" "$data" -o "$out/$name.html" --json "$out/$name.1.json" >/dev/null 2>&1
    [ -s "$out/$name.2.json" ] || "$nacre" report "$asset" "$data" -o "$out/$name.again.html" --json "$out/$name.2.json" --no-selftest >/dev/null 2>&1
    python3 - "$name" "$out/$name.1.json" "$out/$name.2.json" <<'PY'
import json, sys
name, a, b = sys.argv[1], json.load(open(sys.argv[2])), json.load(open(sys.argv[3]))
def front(points, cost):
    on = [p[cost] for p in points if not p['dominated']]
    return f"{len(on)} ({max(on) / min(on):.1f}x)"
again = {p['settings']: p['ms'] for p in b['front_time'] + b['levels']}
both = {p['settings']: p for p in a['front_time'] + a['levels'] if p['settings'] in again}
moved = [s for s, p in both.items() if not p['ms_low'] <= again[s] <= p['ms_high']]
full = next(p for p in a['levels'] if p['settings'] == 'everything')
def level(share): return next((f"{p['psnr_masked']:.2f} dB ({full['psnr_masked'] - p['psnr_masked']:.2f} lost), {p['ms']:.1f} ms" for p in a['levels'] if p['settings'].startswith(share)), '-')
print(f"| {name}, {full['psnr_masked']:.2f} dB, {full['ms']:.1f} ms | {a['seconds']:.0f} | {front(a['front_time'], 'ms')} | {front(a['front_bytes'], 'bytes')} | {len(moved)} of {len(both)} | {level('50 %')} | {level('25 %')} |")
PY
done
echo
echo "| asset | bound: half of its frame time [ms] | tuned: measured [ms] | masked [dB], lost | random splats: share, measured [ms] | masked [dB], lost | tuned is better by [dB] |"
echo "|---|---|---|---|---|---|---|"
for pair in "$@"; do
    asset=${pair%%:*} data=${pair#*:}
    name=$(basename "$asset" .glb)
    evaluated "$asset" "$data"
    full=$(figure ms_per_frame "$out/eval.json") whole=$(figure psnr_masked "$out/eval.json")
    bound=$(awk -v x="$full" 'BEGIN { print x / 2 }')
    "$nacre" tune "$asset" "$data" -o "$out/$name.tuned.glb" --max-ms "$bound" --json "$out/$name.tuned.json" >/dev/null 2>&1
    evaluated "$out/$name.tuned.glb" "$data"
    ms=$(figure ms_per_frame "$out/eval.json") tuned=$(figure psnr_masked "$out/eval.json")
    # Frame time is nearly a line in the number of splats: three steps find the share that takes as long.
    share=0.5
    for _ in 1 2 3; do
        "$build/tests/drop_splats" "$asset" "$out/$name.random.glb" "$share"
        evaluated "$out/$name.random.glb" "$data"
        randomMs=$(figure ms_per_frame "$out/eval.json") random=$(figure psnr_masked "$out/eval.json") used=$share
        share=$(awk -v s="$share" -v have="$randomMs" -v want="$ms" 'BEGIN { s = s * want / have; print (s > 1 ? 1 : s) }')
    done
    awk -v n="$name" -v b="$bound" -v m="$ms" -v w="$whole" -v t="$tuned" -v s="$used" -v rm="$randomMs" -v r="$random" \
        'BEGIN { printf "| %s | %.2f | %.2f | %.2f, %.2f | %.2f, %.2f | %.2f, %.2f | %.2f |\n", n, b, m, t, w - t, s, rm, r, w - r, t - r }'
done
