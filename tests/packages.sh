#!/usr/bin/env bash
# Installs the Debian packages that building and testing Nacre needs, and those named as arguments, if they are not there yet; says which.
set -euo pipefail

packages=(
    g++ cmake ninja-build pkg-config
    libglm-dev libtinygltf-dev nlohmann-json3-dev libstb-dev                       # formats
    libopenexr-dev libdraco-dev libjpeg-dev                                         # datasets and meshes
    libtbb-dev libhwy-dev libembree-dev libcli11-dev                                # baker and command line
    libgl-dev libopengl-dev libegl-dev libegl-mesa0 libgl1-mesa-dri libosmesa6-dev libgles-dev  # headless OpenGL
    libglfw3-dev libimgui-dev                                                       # samples/viewer
    doctest-dev libboost-context-dev xvfb xauth                                      # tests
)
missing=()
for package in "${packages[@]}" "$@"; do
    [ "$(dpkg-query -W -f='${db:Status-Status}' "$package" 2>/dev/null || true)" = installed ] || missing+=("$package")
done
[ ${#missing[@]} -gt 0 ] || exit 0

as_root=()
if [ "$(id -u)" -ne 0 ]; then
    if ! command -v sudo >/dev/null; then
        echo "packages.sh: missing: ${missing[*]}; install them as root (there is no sudo here), then run this again" >&2
        exit 1
    fi
    as_root=(sudo)
fi
echo "installing: ${missing[*]}"
"${as_root[@]}" apt-get update -q
"${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -q -y --no-install-recommends "${missing[@]}"
