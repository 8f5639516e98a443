#!/usr/bin/env bash
# All attacks to their aims, and the long run of the demonstration, on a machine without network.
# usage: attack_bars.sh [--minutes 9] [--workers 16] [--seed 1] [--device cuda|cpu|none]
#
# Expected: the package, installed or on PYTHONPATH; Python with numpy, h5py; the message fuzzer of
# an `asan` build under build/ (it is built where cmake and GoogleTest are; a binary that was linked
# elsewhere may lie in build/asan). Ended early, it leaves what was counted; called again with the
# same seed and build/attack, it goes on. Results go to $LIBMPM_RESULTS (default: results):
#   attacks.json    counts, for: python -m tests.attack --write --collect attacks.json
#   kept.tar.gz     cases that showed a defect
#   long_run.json   the long run, for --collect too;   *.log   what was said
#   long_run.tar    its state, for the next call: LIBMPM_LONG_RUN names it
set -uo pipefail
cd "$(dirname "$0")/.." || exit
minutes=9 workers=$(nproc) seed=1 device=cuda steps=1000000
while [ $# -gt 1 ]; do
  case $1 in
    --minutes) minutes=$2 ;;
    --workers) workers=$2 ;;
    --seed) seed=$2 ;;
    --device) device=$2 ;;
    --steps) steps=$2 ;;
    *) echo "unknown: $1" >&2; exit 2 ;;
  esac
  shift 2
done
python=${LIBMPM_PYTHON:-python3}
results=$(realpath -m "${LIBMPM_RESULTS:-results}")
mkdir -p "$results"
export PYTHONUNBUFFERED=1 MPLBACKEND=Agg OMP_NUM_THREADS=1
status=0 long="" fuzzer=build/asan/tests/cpp/test_solver_rank_fuzz
chmod +x $fuzzer 2>/dev/null
if [ "$(head -c 4 $fuzzer 2>/dev/null | tail -c 3)" != ELF ]; then
  echo "$fuzzer is no program: build it (cmake --preset asan) or put it there, unpacked" >&2
  exit 2
fi
# The long run goes on from the state of an earlier call.
state=build/attack/long
if [ -s "${LIBMPM_LONG_RUN:-}" ] && [ ! -d $state ]; then
  mkdir -p $state && tar xf "$LIBMPM_LONG_RUN" -C $state
fi
if [ "$device" != none ]; then
  "$python" tests/attack/long_run.py --device "$device" --steps "$steps" --kills 8 --state $state \
    --minutes "$(echo "$minutes" | awk '{print $1 * 0.97}')" --results "$results" \
    >"$results/long_run.log" 2>&1 &
  long=$!
fi
"$python" -m tests.attack --bars --workers "$workers" --minutes "$(echo "$minutes" | awk '{print $1 * 0.95}')" \
  --seed "$seed" --results "$results" >"$results/attacks.log" 2>&1 &
attacks=$!
trap 'kill -TERM $attacks $long 2>/dev/null' TERM INT
# A signal ends the first wait before what it is sent to has written its counts.
wait "$attacks" || { wait "$attacks"; status=$?; }
[ -z "$long" ] || wait "$long" || status=1
[ -z "$long" ] || tar cf "$results/long_run.tar" -C $state .
tail -n 60 "$results/attacks.log"
[ -z "$long" ] || tail -n 3 "$results/long_run.log"
exit "$status"
