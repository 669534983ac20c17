#!/usr/bin/env bash
# A runtime is usable from pure C, static and shared: installed (find_package, pkg-config) and as a subdirectory. Nothing of what is inside
# it can be seen by or taken from other libraries of a host. install.sh BUILD_DIR SOURCE_DIR
set -euo pipefail
build=$1 source=$2
if grep -q '^NACRE_SANITIZE:BOOL=ON' "$build/CMakeCache.txt"; then
    echo "SKIPPED: with sanitizers the library links only into programs that have them, too"
    exit 0
fi
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
kept=$build/tests/install # builds of the runtime alone, not optimised, kept so that only the first run takes long

fail() { echo "FAILED: $*"; exit 1; }
quietly() { "$@" >"$work/log" 2>&1 || { cat "$work/log"; fail "$*"; }; }

mkdir -p "$kept/host" "$kept/sub"
cat >"$kept/host/host.c" <<'EOF'
#include <nacre/nacre.h>
#include <stdio.h>
int main(void)
{
    NacreContext context = {17}; /* must become 0 */
    NacreView view = {17};
    if (nacreContextCreate(NULL, &context) != NACRE_ERROR_INVALID_ARGUMENT || context.id != 0) return 1;
    if (nacreViewCreate(context, NULL, &view) != NACRE_ERROR_INVALID_ARGUMENT || view.id != 0) return 1;
    printf("%u\n", (unsigned)nacreVersion());
    return nacreVersion() == NACRE_VERSION_MAJOR * 10000 + NACRE_VERSION_MINOR * 100 + NACRE_VERSION_PATCH ? 0 : 1;
}
EOF
cat >"$kept/host/CMakeLists.txt" <<'EOF'
cmake_minimum_required(VERSION 3.25)
project(host LANGUAGES C)
find_package(nacre 0.2 CONFIG REQUIRED)
add_executable(host host.c)
target_link_libraries(host PRIVATE nacre::runtime)
EOF
cat >"$kept/sub/CMakeLists.txt" <<'EOF'
cmake_minimum_required(VERSION 3.25)
project(host LANGUAGES C)
set(NACRE_BUILD_BAKER OFF)
add_subdirectory("${NACRE_SOURCE}" nacre)
add_executable(host ../host/host.c)
target_link_libraries(host PRIVATE nacre::runtime)
EOF

# Symbols that others could see, one a line; what is not the C API.
foreign() { nm "$@" --defined-only --format=posix | awk 'NF > 2 && $2 != "A" { print $1 }' | grep -v '^nacre[A-Z]' || true; }

usableFromC() { # PREFIX
    quietly cmake -G Ninja -S "$kept/host" -B "$1/host" -DCMAKE_PREFIX_PATH="$1"
    quietly cmake --build "$1/host"
    quietly "$1/host/host"
    local pc
    pc=$(dirname "$(find "$1" -name nacre.pc)")
    # shellcheck disable=SC2046
    quietly cc -std=c99 -Wall -Wextra -Werror -pedantic "$kept/host/host.c" -o "$1/with_pkg_config" $(PKG_CONFIG_PATH=$pc pkg-config --cflags --libs nacre)
    LD_LIBRARY_PATH=$(dirname "$pc") quietly "$1/with_pkg_config"
}

usableAsSubdirectory() { # BUILD_SHARED_LIBS
    quietly cmake -G Ninja -S "$kept/sub" -B "$kept/sub/$1" -DNACRE_SOURCE="$source" -DBUILD_SHARED_LIBS="$1" -DCMAKE_BUILD_TYPE=None
    quietly cmake --build "$kept/sub/$1" --target host
    quietly "$kept/sub/$1/host"
}

# ---- static
quietly cmake --install "$build" --prefix "$work/static" --component runtime
archive=$(find "$work/static" -name 'libnacre_runtime.a')
[ -n "$archive" ] || fail "no libnacre_runtime.a was installed"
seen=$(foreign --extern-only "$archive")
[ -z "$seen" ] || fail "the static library shows: $seen"
usableFromC "$work/static"
usableAsSubdirectory OFF

# A host with libraries of its own that bear the names of ours keeps them, linked before or after Nacre.
cat >"$work/own.cpp" <<'EOF'
#include <exception>
namespace tinygltf { struct TinyGLTF { bool ok(); virtual ~TinyGLTF(); }; bool TinyGLTF::ok() { return true; } TinyGLTF::~TinyGLTF() {} }
namespace nlohmann { inline namespace json_abi_v3_11_2 { namespace detail {
struct exception : std::exception { const char* what() const noexcept override; };
const char* exception::what() const noexcept { return "own"; }
} } }
extern "C" int stbi_failure_reason() { return 17; }
bool ownLibrariesAnswer()
{
    tinygltf::TinyGLTF gltf;
    return gltf.ok() && nlohmann::detail::exception().what()[0] == 'o' && stbi_failure_reason() == 17;
}
EOF
cat >"$work/main.cpp" <<'EOF'
#include <nacre/nacre.h>
bool ownLibrariesAnswer();
int main()
{
    NacreContext context{};
    return nacreContextCreate(nullptr, &context) == NACRE_ERROR_INVALID_ARGUMENT && ownLibrariesAnswer() ? 0 : 1;
}
EOF
quietly c++ -c "$work/own.cpp" -o "$work/own.o"
quietly c++ "$work/main.cpp" -I"$work/static/include" "$work/own.o" "$archive" -o "$work/own_first"
quietly c++ "$work/main.cpp" -I"$work/static/include" "$archive" "$work/own.o" -o "$work/own_last"
quietly "$work/own_first"
quietly "$work/own_last"

# ---- shared
quietly cmake -G Ninja -S "$source" -B "$kept/shared" -DBUILD_SHARED_LIBS=ON -DCMAKE_BUILD_TYPE=None \
    -DNACRE_BUILD_BAKER=OFF -DNACRE_BUILD_TESTS=OFF -DNACRE_BUILD_SAMPLES=OFF
quietly cmake --build "$kept/shared"
quietly cmake --install "$kept/shared" --prefix "$work/shared" --component runtime
library=$(find "$work/shared" -name 'libnacre_runtime.so')
readelf -d "$library" | grep -q 'SONAME.*libnacre_runtime\.so\.[0-9]' || fail "the shared library has no version in its SONAME"
seen=$(foreign --dynamic "$library")
[ -z "$seen" ] || fail "the shared library shows: $seen"
if readelf -d "$library" "$work/own_first" | grep -E 'NEEDED.*(tinygltf|stb)'; then fail "the runtime needs libraries of the baker"; fi
usableFromC "$work/shared"
usableAsSubdirectory ON
