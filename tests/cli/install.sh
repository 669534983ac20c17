#!/usr/bin/env bash
# An installed runtime is usable from C, through find_package and through pkg-config. install.sh BUILD_DIR
set -euo pipefail
if grep -q '^NACRE_SANITIZE:BOOL=ON' "$1/CMakeCache.txt"; then
    echo "SKIPPED: with sanitizers the library links only into programs that have them, too"
    exit 0
fi
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cmake --install "$1" --prefix "$work/prefix" --component runtime >/dev/null
cd "$work"

cat >host.c <<'END'
#include <nacre/nacre.h>
#include <stdio.h>
int main(void)
{
    NacreContext context = (NacreContext)&context; /* must become NULL */
    if (nacreContextCreate(NULL, &context) != NACRE_ERROR_INVALID_ARGUMENT || context != NULL) return 1;
    printf("%u\n", (unsigned)nacreVersion());
    return nacreVersion() == NACRE_VERSION_MAJOR * 10000 + NACRE_VERSION_MINOR * 100 + NACRE_VERSION_PATCH ? 0 : 1;
}
END
cat >CMakeLists.txt <<'END'
cmake_minimum_required(VERSION 3.25)
project(host LANGUAGES C CXX)
find_package(nacre 0.1 CONFIG REQUIRED)
add_executable(host host.c)
target_link_libraries(host PRIVATE nacre::runtime)
END
cmake -G Ninja -S . -B build -DCMAKE_PREFIX_PATH="$work/prefix" >configure.txt 2>&1 || { cat configure.txt; exit 1; }
cmake --build build >build.txt 2>&1 || { cat build.txt; exit 1; }
build/host

PKG_CONFIG_PATH=$(dirname "$(find "$work/prefix" -name nacre.pc)")
export PKG_CONFIG_PATH
# shellcheck disable=SC2046
cc -std=c99 -Wall -Wextra -Werror -pedantic host.c -o host $(pkg-config --cflags --libs nacre)
./host
