#!/usr/bin/env bash
# Our .ply through PlayCanvas' splat-transform and back, in its own formats and in its .glb: every splat and every number stay, as exactly as each
# format holds them. ply.sh NACRE [SPLATS.ply]; without a file, random splats. SKIPPED without node, npm or network.
set -uo pipefail
nacre=$(realpath "$1")
splats=${2:+$(realpath "$2")}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work" || exit 1
for tool in node npm; do command -v $tool >/dev/null || { echo "SKIPPED: no $tool"; exit 0; }; done
npm install --no-audit --no-fund --silent @playcanvas/splat-transform >npm.txt 2>&1 || { echo "SKIPPED: npm cannot install @playcanvas/splat-transform: $(tail -1 npm.txt)"; exit 0; }
transform=(node_modules/.bin/splat-transform -q -w -g cpu)

cat >tool.mjs <<'JS'
// tool.mjs make OUT | compare A B POSITION OTHERS SH: the largest differences, and exit code 1 if one exceeds its bound
import fs from 'fs';
const rest = [...Array(45).keys()].map(k => `f_rest_${k}`);
const names = ['x', 'y', 'z', 'f_dc_0', 'f_dc_1', 'f_dc_2', ...rest, 'opacity', 'scale_0', 'scale_1', 'scale_2', 'rot_0', 'rot_1', 'rot_2', 'rot_3'];
function read(path) {
    const bytes = fs.readFileSync(path), end = bytes.indexOf('end_header\n') + 11, columns = [];
    let count = 0;
    for (const line of bytes.subarray(0, end).toString().split('\n')) {
        const w = line.split(' ');
        if (w[0] === 'element') count = +w[2];
        if (w[0] === 'property') { if (w[1] !== 'float') throw new Error(`${path}: ${line}`); columns.push(w[2]); }
    }
    const splats = [];
    for (let i = 0; i < count; ++i) {
        const s = {};
        columns.forEach((name, k) => { s[name] = bytes.readFloatLE(end + 4 * (i * columns.length + k)); });
        const length = Math.hypot(s.rot_0, s.rot_1, s.rot_2, s.rot_3);
        for (let k = 0; k < 4; ++k) s[`rot_${k}`] /= length;
        s.opacity = 1 / (1 + Math.exp(-s.opacity));
        splats.push(s);
    }
    return splats;
}
// A rotation and its negative are the same.
function difference(s, t, name) {
    if (!name.startsWith('rot')) return Math.abs(s[name] - t[name]);
    const dot = s.rot_0 * t.rot_0 + s.rot_1 * t.rot_1 + s.rot_2 * t.rot_2 + s.rot_3 * t.rot_3;
    return Math.abs(s[name] - Math.sign(dot) * t[name]);
}
if (process.argv[2] === 'make') {
    let seed = 1;
    const random = () => (seed = (seed * 1103515245 + 12345) % 2147483648) / 2147483648 - 0.5;
    const rows = [];
    for (let i = 0; i < 500; ++i)
        for (const name of names)
            rows.push('xyz'.includes(name) ? 2 * random() : name.startsWith('scale') ? random() - 4 : name.startsWith('rot') ? random() : name === 'opacity' ? 6 * random() : 0.6 * random());
    fs.writeFileSync(process.argv[3], Buffer.concat([Buffer.from(`ply\nformat binary_little_endian 1.0\nelement vertex 500\n${names.map(n => `property float ${n}\n`).join('')}end_header\n`), Buffer.from(new Float32Array(rows).buffer)]));
} else {
    const [a, b] = [read(process.argv[3]), read(process.argv[4])], bounds = process.argv.slice(5).map(Number), most = [0, 0, 0, 0];
    if (a.length !== b.length) { console.log(`${b.length} splats, expected ${a.length}`); process.exit(1); }
    // Tools reorder: the nearest splat that is not taken, found on a grid of positions.
    const cell = 4 * bounds[0] + 1e-4, key = (p, d) => [0, 1, 2].map(k => Math.floor(p['xyz'[k]] / cell) + d[k]).join();
    const grid = new Map();
    b.forEach(s => { const k = key(s, [0, 0, 0]); grid.has(k) ? grid.get(k).push(s) : grid.set(k, [s]); });
    const near = [];
    for (let k = 0; k < 27; ++k) near.push([k % 3 - 1, (k / 3 | 0) % 3 - 1, (k / 9 | 0) - 1]);
    for (const s of a) {
        let best = null, least = Infinity;
        for (const d of near)
            for (const t of grid.get(key(s, d)) ?? []) {
                const distance = names.reduce((sum, n) => sum + ('xyz'.includes(n) ? 1e4 : 1) * difference(s, t, n) ** 2, 0);
                if (distance < least) least = distance, best = t;
            }
        if (!best) { console.log('a splat is missing'); process.exit(1); }
        for (const n of names) {
            const kind = n.startsWith('f_') ? 2 : 'xyz'.includes(n) ? 0 : n.startsWith('rot') ? 3 : 1;
            most[kind] = Math.max(most[kind], difference(s, best, n));
        }
    }
    const text = most.map((x, k) => `${['position', 'log scale, opacity', 'SH', 'rotation'][k]} ${x.toPrecision(2)}`).join(', ');
    console.log(`${a.length} splats, largest difference: ${text}`);
    process.exit(most[0] <= bounds[0] && most[1] <= bounds[1] && most[2] <= bounds[2] && most[3] <= bounds[1] ? 0 : 1);
}
JS

failures=0
fail() { echo "FAILED: $*"; failures=$((failures + 1)); }
if [ -z "$splats" ]; then
    node tool.mjs make raw.ply || exit 1
    "$nacre" convert raw.ply in.ply >/dev/null || exit 1
else
    cp "$splats" in.ply
fi
node_modules/.bin/splat-transform --version 2>&1 | head -1
# way: what lies between our .ply and the one that comes back; bounds of position, of scale, opacity and rotation, of SH
while read -r way position others sh; do
    if ! "${transform[@]}" in.ply "out$way" >log.txt 2>&1; then fail "in.ply -> $way: $(tail -1 log.txt)"; continue; fi
    if [ "$way" = .glb ]; then "$nacre" convert out.glb back.ply --axes y-down >log.txt 2>&1 || fail "nacre convert of its .glb: $(cat log.txt)"
    elif [ "$way" != .ply ]; then "${transform[@]}" "out$way" back.ply >log.txt 2>&1 || fail "$way -> back.ply: $(tail -1 log.txt)"
    else cp out.ply back.ply; fi
    "$nacre" convert back.ply ours.ply >log.txt 2>&1 || { fail "nacre does not read what $way became: $(cat log.txt)"; continue; }
    printf '%s: ' "$way"
    node tool.mjs compare in.ply ours.ply "$position" "$others" "$sh" || fail "$way: not the same splats"
done <<'WAYS'
.ply 0 1e-6 0
.glb 1e-5 1e-5 1e-5
.spz 3e-4 0.05 0.2
.compressed.ply 2e-3 0.05 0.1
WAYS
[ $failures = 0 ] && echo "all well"
exit $((failures > 0))
