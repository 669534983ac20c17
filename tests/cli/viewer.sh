#!/usr/bin/env bash
# The viewer, from outside, on a virtual screen: its picture holds the object, edits change it, errors are one line.
# viewer.sh VIEWER WRITE_ASSETS; VIEWER is empty where it was not built
set -uo pipefail
viewer=$1
write_assets=$2
skip() { echo "SKIPPED: $*"; exit 0; }

[ -n "$viewer" ] || skip "samples/viewer was not built (it needs libglfw3-dev and libimgui-dev)"
if [ "${3:-}" != inside ]; then
    command -v xvfb-run >/dev/null || skip "there is no xvfb-run (package xvfb)"
    command -v xauth >/dev/null || skip "xvfb-run needs xauth (package xauth)"
    exec xvfb-run -a "$0" "$viewer" "$write_assets" inside
fi

# GLFW unloads the GL driver, after which what the driver keeps for good looks leaked. The runtime's own leaks show in its unit tests.
export ASAN_OPTIONS="${ASAN_OPTIONS:+$ASAN_OPTIONS:}detect_leaks=0"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work" || exit 1
failures=0
fail() { echo "FAILED: $*"; failures=$((failures + 1)); }

# expect CODE TEXT COMMAND...: exit code, and on failure exactly one line, that contains TEXT
expect() {
    local code=$1 text=$2 got=0
    shift 2
    "$@" >stdout.txt 2>stderr.txt || got=$?
    [ "$got" = "$code" ] || { fail "exit code $got, expected $code: $*"; cat stderr.txt; return; }
    [ "$code" = 0 ] && return
    [ "$(wc -l <stderr.txt)" = 1 ] && grep '^viewer: error: ' stderr.txt | grep -qF -- "$text" ||
        { fail "expected one line about '$text': $*"; cat stderr.txt; }
}

# shot NAME ASSET OPTION...: NAME.ppm, without the panel
shot() {
    local name=$1 asset=$2
    shift 2
    expect 0 "" "$viewer" "$asset" --no-panel --size 160x120 --screenshot "$name.ppm" "$@"
}

# object_pixels FILE: how many of the 160x120 pixels differ from the first, which is background
object_pixels() { tail -c 57600 "$1" | od -An -v -tu1 -w3 | awk 'NR == 1 { first = $0 } $0 != first { ++n } END { print n + 0 }'; }

"$write_assets" . || { echo "FAILED: $write_assets"; exit 1; }
"$viewer" sss.glb --size 16x16 --frames 1 --screenshot first.ppm 2>first.txt
grep -q 'cannot open a window' first.txt && skip "no window with OpenGL 3.3 on a virtual screen: $(cat first.txt)"

echo "-- pictures"
for model in bigs sss; do
    shot $model $model.glb
    pixels=$(object_pixels $model.ppm)
    [ "$pixels" -ge 960 ] && [ "$pixels" -le 18240 ] || fail "the object of $model.glb covers $pixels pixels of 19200, expected 5 % to 95 %"
done
shot factor1 sss.glb --edit basecolor=x1 --edit residual=x1@sphere:0,0,0,1
cmp sss.ppm factor1.ppm || fail "edits with factor 1 change pixels"
shot elsewhere sss.glb --edit basecolor=1,0,0@box:50,50,50,60,60,60
cmp sss.ppm elsewhere.ppm || fail "an edit beside the object changes pixels"
for edit in basecolor=1,0,0 basecolor=x0.1@sphere:0,0,0,1 metalness=1 tint=x4,1,1 opacity=x0.5; do
    shot edited sss.glb --edit $edit
    cmp -s sss.ppm edited.ppm && fail "--edit $edit changes nothing"
done
shot once sss.glb --edit roughness=0.5 --edit roughness=x0.5
shot twice sss.glb --edit roughness=x0.5 --edit roughness=0.5
cmp -s once.ppm twice.ppm && fail "edits of one target do not apply in order"
expect 0 "" "$viewer" sss.glb --size 640x400 --screenshot panel.ppm --edit opacity=0.5@box:-1,-1,-1,1,1,1
expect 0 "" "$viewer" bigs.glb --size 640x400 --frames 2

echo "-- errors"
expect 0 "" "$viewer" --help
expect 2 "no asset" "$viewer"
expect 2 "--nosuch" "$viewer" sss.glb --nosuch
expect 2 "bigs.glb" "$viewer" sss.glb bigs.glb
expect 2 "nosuch.glb" "$viewer" nosuch.glb
expect 2 "$work" "$viewer" "$work"
head -c 1000 sss.glb >cut.glb
expect 2 "cut.glb" "$viewer" cut.glb --screenshot a.ppm
for bad in color=1 roughness roughness=2 roughness=nan basecolor=1,2 roughness=0.5@ball:0,0,0,1 roughness=0.5@sphere:0,0,0; do
    expect 2 "$bad" "$viewer" sss.glb --edit $bad
done
expect 2 "bigs" "$viewer" bigs.glb --edit roughness=0.5 --screenshot a.ppm
for bad in 0x5 64 64x64x 9000x64; do expect 2 "--size" "$viewer" sss.glb --size $bad; done
for bad in 0 -1 x; do expect 2 "--frames" "$viewer" sss.glb --frames $bad; done
expect 2 "needs a value" "$viewer" sss.glb --frames
expect 2 ".ppm" "$viewer" sss.glb --screenshot a.jpg
expect 2 "cannot open a window" env -u DISPLAY -u WAYLAND_DISPLAY "$viewer" sss.glb --screenshot a.ppm
expect 1 "nosuch/a.ppm" "$viewer" sss.glb --size 64x64 --screenshot nosuch/a.ppm
[ ! -e a.ppm ] || fail "a refused command left a.ppm"

[ $failures = 0 ] || { echo "$failures checks FAILED"; exit 1; }
echo "all checks passed"
