#!/usr/bin/env bash
# Installs Debian and gslcosim for aarch64 into a folder, with a command `python` that runs them under qemu:
# `tests/freeze/aarch64.sh FOLDER`. It needs debootstrap, qemu-user, the network and 2 GB.
set -euo pipefail
cd "$(dirname "$0")/../.."
folder=$(realpath -m "$1")
pip=(.venv/bin/python -m pip --quiet --disable-pip-version-check)
mkdir -p "$folder"
debootstrap --foreign --arch=arm64 --variant=minbase --include=python3,libgl1,libegl1,libosmesa6 bookworm "$folder/root"
for package in "$folder"/root/var/cache/apt/archives/*.deb; do dpkg-deb -x "$package" "$folder/root"; done

distributions=(. extensions/search extensions/formats)
platforms=()
for glibc in 2_17 2_26 2_27 2_28 2_31; do platforms+=(--platform "manylinux_${glibc}_aarch64"); done
requirements=$folder/requirements.txt
.venv/bin/python - "${distributions[@]}" > "$requirements" <<'END'
import sys, tomllib
for folder in sys.argv[1:]:
    with open(f"{folder}/pyproject.toml", "rb") as file:
        print(*(each for each in tomllib.load(file)["project"]["dependencies"] if not each.startswith("gslcosim")), sep="\n")
END
"${pip[@]}" install --no-compile --upgrade --target "$folder/site" --only-binary=:all: --python-version 3.11 --implementation cp \
    --abi cp311 --abi abi3 --abi none "${platforms[@]}" --platform manylinux2014_aarch64 \
    --constraint requirements.lock --requirement "$requirements"
for distribution in "${distributions[@]}"; do
    "${pip[@]}" wheel --no-deps --no-build-isolation --wheel-dir "$folder/wheels" "$distribution"
done
"${pip[@]}" install --no-compile --no-deps --upgrade --target "$folder/site" "$folder"/wheels/*.whl

# Programs that Python starts are to be emulated too.
echo "import sys; sys.executable = sys._base_executable = '$folder/python'" > "$folder/site/sitecustomize.py"
cat > "$folder/python" <<END
#!/bin/sh
PYTHONPATH=$folder/site exec qemu-aarch64 -L $folder/root $folder/root/usr/bin/python3.11 "\$@"
END
chmod +x "$folder/python"
