#!/usr/bin/env bash
# The smallest hosts, from outside: those without a window draw the object, the same one; the one with a window runs on a virtual screen.
# hello.sh WRITE_ASSETS HELLO_SPLAT HELLO_OSMESA HELLO_GLFW; the last two are empty where they were not built
set -uo pipefail
write_assets=$1 splat=$2 osmesa=$3 glfw=$4
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work" || exit 1
# Drivers keep memory for good when they are unloaded or their context is left. The runtime's own leaks show in its unit tests.
export ASAN_OPTIONS="${ASAN_OPTIONS:+$ASAN_OPTIONS:}detect_leaks=0"
failures=0
fail() { echo "FAILED: $*"; failures=$((failures + 1)); }

"$write_assets" . || { echo "FAILED: $write_assets"; exit 1; }
size=$((512 * 512 * 3))
# lit FILE: pixels of the 512x512 that are not black
lit() { tail -c $size "$1" | od -An -v -tu1 -w3 | awk '$1 + $2 + $3 > 0 { ++n } END { print n + 0 }'; }
# differences A B: numbers of the pictures that differ by more than 2 of 255
differences() {
    cmp -l "$1" "$2" | awk 'function octal(s) { return 64 * int(s / 100) + 8 * int(s % 100 / 10) + s % 10 }
                            { d = octal($2) - octal($3); if (d > 2 || d < -2) ++n } END { print n + 0 }'
}

for model in bigs sss; do
    "$splat" $model.glb egl.ppm || fail "hello_splat $model.glb"
    pixels=$(lit egl.ppm)
    [ "$pixels" -ge 13107 ] && [ "$pixels" -le 249036 ] || fail "hello_splat: the object of $model.glb covers $pixels pixels, expected 5 % to 95 %"
    if [ -n "$osmesa" ]; then
        "$osmesa" $model.glb osmesa.ppm || fail "hello_osmesa $model.glb"
        [ "$(differences egl.ppm osmesa.ppm)" = 0 ] || fail "hello_osmesa draws another picture of $model.glb than hello_splat"
    fi
done
[ -n "$osmesa" ] || echo "SKIPPED: samples/hello_osmesa was not built (it needs libosmesa6-dev)"
if [ -z "$glfw" ]; then echo "SKIPPED: samples/hello_glfw was not built (it needs libglfw3-dev)"
elif ! command -v xvfb-run >/dev/null || ! command -v xauth >/dev/null; then echo "SKIPPED: hello_glfw needs a virtual screen (packages xvfb, xauth)"
else
    for model in bigs sss; do xvfb-run -a "$glfw" $model.glb 3 || fail "hello_glfw $model.glb"; done
    xvfb-run -a "$glfw" missing.glb 1 2>/dev/null && fail "hello_glfw runs without an asset"
fi
"$splat" missing.glb out.ppm 2>/dev/null && fail "hello_splat runs without an asset"

[ $failures = 0 ] || { echo "$failures checks FAILED"; exit 1; }
echo "all checks passed"
