#!/usr/bin/env bash
# An asset of profile interop in the hands of others: the validator, three viewers, and two scripts that reorder and crop splats.
# run.sh [NACRE]; needs node and, for its packages, the network, or a folder node_modules that has them: NACRE_NODE_MODULES=FOLDER.
# Apart from tests/run.sh, so that the ordinary suite needs neither.
set -uo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
nacre=$(realpath "${1:-$here/../../build/baker/nacre}")
sample=$here/../../samples/data/bunny_wax_tiny
packages=(three@0.187.0 @babylonjs/core@9.35.0 @babylonjs/loaders@9.28.0 playcanvas@2.23.3 gltf-validator@2.0.0-dev.3.10 @gltf-transform/core@4.5.1)

skipped() { echo "SKIPPED: $*"; exit 0; }
node=$(command -v node) || skipped "there is no node"
[ "$(node -p 'parseInt(process.versions.node)')" -ge 20 ] || skipped "node $(node --version) is older than 20"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cp "$here"/*.mjs "$work"
cd "$work" || exit 1
if [ -n "${NACRE_NODE_MODULES:-}" ]; then
    ln -s "$(realpath "$NACRE_NODE_MODULES")" node_modules
else
    npm install --no-audit --no-fund --ignore-scripts "${packages[@]}" >npm.log 2>&1 || skipped "npm cannot install ${packages[*]}: $(grep -m 1 'npm error' npm.log)"
fi

failures=0
fail() { echo "FAILED: $*"; failures=$((failures + 1)); }
quietly() { "$@" >log 2>&1 || { fail "$*"; cat log; }; }

# script NAME ARGUMENT...: its last lines; a library that is not there or does not start without a browser is skipped
script() {
    "$node" "$@" >log 2>&1 && { grep -v '^BJS\|^Missing optional' log; return; }
    if grep -q '^FAILED' log; then grep '^FAILED' log; failures=$((failures + 1))
    elif grep -q 'ERR_MODULE_NOT_FOUND\|ReferenceError: .* is not defined' log; then echo "SKIPPED: $*: $(grep -m 1 'Error' log)"
    else fail "$*"; cat log
    fi
}

# lit NAME: NAME.glb under two lights
lit() {
    local i=0 light
    for light in point:2,0,3:40 point:-2,1,-3:40; do
        quietly "$nacre" render "$1.glb" -o "$1.$((i++)).exr" --size 96x96 --orbit 30,20 --light $light --renderer reference
    done
    cmp -s "$1.0.exr" "$1.1.exr" && fail "$1.glb looks the same under two lights"
}

# others NAME: NAME.glb in the hands of others
others() {
    echo "-- $1.glb"
    lit $1
    script validate.mjs $1.glb
    local viewer tool how i before
    for viewer in three babylon playcanvas; do script $viewer.mjs $1.glb; done
    for tool in edit transform; do
        for how in reverse crop; do
            rm -f edited*
            before=$failures
            script $tool.mjs $how $1.glb edited.glb
            [ -e edited.glb ] || continue
            lit edited
            for i in 0 1; do
                if [ $how = reverse ]; then cmp $1.$i.exr edited.$i.exr || fail "in another order ($tool.mjs) the splats look otherwise under light $i"
                else cmp -s $1.$i.exr edited.$i.exr && fail "cropped ($tool.mjs), the splats look as before"
                fi
            done
            [ $failures = $before ] && echo "$tool.mjs $how: relights"
        done
    done
    script edit.mjs move $1.glb moved.glb
    "$nacre" render moved.glb -o moved.png --renderer reference >log 2>&1
    if grep -q 'relighting data belong to other positions' log; then echo "edit.mjs move: $(cat log)"
    else fail "splats that were moved are not called stale"; cat log
    fi
}

for model in bigs sss; do
    quietly "$nacre" bake "$sample" -o $model.glb --model $model --iterations 20 --max-splats 300 --profile interop
    quietly "$nacre" bake "$sample" -o compact.glb --model $model --iterations 20 --max-splats 300
    quietly "$nacre" pack compact.glb -o packed_$model.glb --profile interop
    others $model
    others packed_$model
done
[ $failures = 0 ] || { echo "$failures checks failed"; exit 1; }
