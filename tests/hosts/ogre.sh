#!/usr/bin/env bash
# Nacre in OGRE, on a virtual screen.
# ogre.sh TEST SAMPLE WRITE_ASSETS; TEST is empty where it was not built
set -uo pipefail
skip() { echo "SKIPPED: $*"; exit 0; }

[ -n "$1" ] || skip "samples/ogre was not built (it needs libogre-1.12-dev; tests/hosts.sh installs it)"
if [ "${4:-}" != inside ]; then
    command -v xvfb-run >/dev/null || skip "there is no xvfb-run (package xvfb)"
    command -v xauth >/dev/null || skip "xvfb-run needs xauth (package xauth)"
    exec xvfb-run -a "$0" "$1" "$2" "$3" inside
fi

# OGRE keeps what it has until the process ends. The runtime's own leaks show in its unit tests.
export ASAN_OPTIONS="${ASAN_OPTIONS:+$ASAN_OPTIONS:}detect_leaks=0"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work" || exit 1
"$3" . || { echo "FAILED: $3"; exit 1; }
"$1" || exit 1

"$2" bigs_ball.glb sss_ball.glb --size 160x120 --frames 2 --headless out.png || { echo "FAILED: the sample"; exit 1; }
[ "$(head -c 4 out.png | tail -c 3)" = PNG ] || { echo "FAILED: the sample wrote no picture"; exit 1; }
"$2" bigs_ball.glb --size 160x120 --frames 3 || { echo "FAILED: the sample in a window"; exit 1; }
if "$2" nosuch.glb --headless a.png 2>error.txt || ! grep -q nosuch.glb error.txt; then
    echo "FAILED: an asset that is not there: expected an error that names it"
    cat error.txt
    exit 1
fi
echo "all checks passed"
