#!/usr/bin/env bash
# Nacre in real engines: installs OGRE where it is missing, builds samples/ogre into build-hosts/ and runs its checks on a virtual screen.
# Apart from tests/run.sh, so that the ordinary suite needs no engine. Arguments go to ctest.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

tests/packages.sh libogre-1.12-dev libglx-dev libgl-dev
cmake -G Ninja -S . -B build-hosts -DCMAKE_BUILD_TYPE=Release -DNACRE_BUILD_BAKER=OFF -DNACRE_BUILD_OGRE=ON
cmake --build build-hosts --target test_ogre ogre write_assets
ctest --test-dir build-hosts --output-on-failure -R '^ogre$' "$@"
