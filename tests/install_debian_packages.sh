#!/usr/bin/env bash
# Installs what the tests need from Debian, where that is possible: as root, with apt-get.
# What is there already is left alone. Elsewhere it says what is missing; the tests that need it are then skipped.
set -euo pipefail

packages=(
    gcc g++ cmake make pkg-config
    libjansson-dev       # agents/dung_beetle_c
    nlohmann-json3-dev   # agents/dung_beetle_cpp
    octave               # agents/dung_beetle_octave
    jq                   # agents/dung_beetle_shell
    mesa-vulkan-drivers  # pictures of recordings without a GPU
    libegl1 libgl1-mesa-dri libosmesa6  # cameras without a GPU
    bubblewrap           # the stronger sandbox of agents
    iproute2 openssl     # two hosts in network namespaces, and their certificate
    openfoam             # the other wind solver
    chromium             # the player on a site's pages
    zsh fish             # shells that complete commands
)

command -v dpkg-query >/dev/null || exit 0
missing=()
for package in "${packages[@]}"; do
    [[ $(dpkg-query --show --showformat='${db:Status-Status}' "$package" 2>/dev/null) == installed ]] || missing+=("$package")
done
((${#missing[@]})) || exit 0

if ((EUID)) || ! command -v apt-get >/dev/null; then
    echo "Not installed, so some tests are skipped: ${missing[*]}" >&2
    echo "Install them with: sudo apt-get install --no-install-recommends ${missing[*]}" >&2
    exit 0
fi
echo "Installing ${missing[*]}" >&2
export DEBIAN_FRONTEND=noninteractive
apt-get install --quiet=2 --no-install-recommends "${missing[@]}" >/dev/null ||
    { apt-get update --quiet=2 && apt-get install --quiet=2 --no-install-recommends "${missing[@]}" >/dev/null; } ||
    echo "apt-get could not install them; some tests are skipped." >&2
