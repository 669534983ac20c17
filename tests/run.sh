#!/usr/bin/env bash
# Installs what is missing, builds Release into build/ and runs every test. Arguments go to ctest, e.g. -R cli.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

tests/packages.sh
cmake --preset release
cmake --build build
ctest --test-dir build --output-on-failure "$@"
