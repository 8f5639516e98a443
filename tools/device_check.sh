#!/usr/bin/env bash
# Everything that is run on a machine with a GPU and no network, before a change to CUDA is done.
# usage: device_check.sh build|test|sanitize|bench|ranks ...   (several may follow each other)
#
# Expected there: nvcc, Python 3.11 or newer with numpy, h5py, scikit-build-core, pybind11, cmake and
# ninja, and
#   LIBMPM_EIGEN_INCLUDE  a folder with Eigen's headers (it holds Eigen/Core)
#   LIBMPM_WHEELS         a folder of wheels for what is missing there; optional
#   LIBMPM_RESULTS        where logs, figures and benchmark lines go (default: results)
#   LIBMPM_PYTHON         the interpreter (default: python3)
#   CUDAARCHS             what to build for (default: native)
#   LIBMPM_PYTEST         what to test (default: all that is marked gpu)
#   LIBMPM_BENCH_SIZES    particles of the benchmarks (default: 100000 1000000 8000000)
#   LIBMPM_SANITIZE_TOOLS, LIBMPM_SANITIZE_STEPS
#   LIBMPM_RANK_CASES     cases of many_gpus.py (default: mixing weak strong large capacity)
#   LIBMPM_RANK_SECONDS   of each of their runs at most (default: 3)
set -euo pipefail
cd "$(dirname "$0")/.."
root=$PWD
python=${LIBMPM_PYTHON:-python3}
results=$(realpath -m "${LIBMPM_RESULTS:-results}")
site=$root/build/device-site
mkdir -p "$results" "$site"
export PYTHONPATH="$site${PYTHONPATH:+:$PYTHONPATH}" PYTHONUNBUFFERED=1 MPLBACKEND=Agg
export PATH="$site/bin:$PATH:/usr/local/cuda/bin" CUDAARCHS=${CUDAARCHS:-native}
export LIBMPM_REQUIRE_GPU=1
offline=(--disable-pip-version-check --no-index --no-deps --upgrade --target "$site")

build() {
  if [ -n "${LIBMPM_WHEELS:-}" ]; then
    "$python" -m pip install -q "${offline[@]}" "$LIBMPM_WHEELS"/*.whl
  fi
  rm -rf "$site"/libmpm "$site"/libmpm-*
  "$python" -m pip install "${offline[@]}" --no-build-isolation -C cmake.define.LIBMPM_CUDA=ON . \
    2>&1 | tee "$results/build.log"
  (cd / && "$python" -m libmpm info) | tee "$results/info.txt"
}

test() {
  "$python" -m pytest -m gpu --durations=15 -p no:cacheprovider ${LIBMPM_PYTEST:-} \
    2>&1 | tee "$results/pytest.log"
}

sanitize() {
  # Small enough for the slow tools, yet with two materials, an obstacle, sensors and a sort.
  local scene=$root/build/device-scene.py tool
  cat >"$scene" <<'SCENE'
import sys
import libmpm

scene = libmpm.Scene(
    dimension=3, cell_size=0.05, lower=(0, 0, 0), upper=(1.2, 0.4, 0.6), gravity=(0, 0, -9.81)
)
scene.add_body(
    name="water",
    shape=libmpm.shapes.Box(lower=(0, 0, 0), upper=(0.4, 0.4, 0.3)),
    material=libmpm.materials.TaitFluid(density=1000, bulk_modulus=1e5),
    particles_per_cell=8,
)
scene.add_body(
    name="block",
    shape=libmpm.shapes.Box(lower=(0.6, 0.1, 0), upper=(0.75, 0.3, 0.15)),
    material=libmpm.materials.FixedCorotated(
        density=500, youngs_modulus=1e6, poissons_ratio=0.3
    ),
    particles_per_cell=8,
)
scene.add_boundary(
    name="walls", shape=libmpm.shapes.DomainWalls(), response=libmpm.boundaries.Slip()
)
scene.add_boundary(
    name="pier",
    shape=libmpm.shapes.Box(lower=(0.95, 0.1, 0), upper=(1.05, 0.3, 0.6)),
    response=libmpm.boundaries.Separable(),
)
scene.add_sensor(name="load", sensor=libmpm.sensors.LoadCell(boundary="pier", interval=1e-3))
scene.add_sensor(name="energy", sensor=libmpm.sensors.Energy(interval=1e-3))
for precision in ("single", "mixed", "double"):
    for pipeline in ("auto", "two-pass"):
        sim = libmpm.Simulation(scene, device="cuda", precision=precision, pipeline=pipeline)
        sim.step(int(sys.argv[1]))
        position = sim.particles["water"]["position"]
        assert (position == position).all()
        print(precision, pipeline, sim.time, sim.sensors["load"].values[-1:])
# The phased step: stencils of three and five nodes, stored velocities, sweeps, the split F-bar.
methods = [
    ({"scheme": "ASFLIP", "flip": 0.9, "shift_max": 0.1}, "quadratic", None),
    ({"scheme": "XPIC", "order": 3, "every": 2}, "cpgimp", None),
    ({"scheme": "FMPM", "order": 3}, "cubic", libmpm.FBar(form="split", ratio=0.9)),
]
for transfer, kernel, fbar in methods:
    data = scene.to_dict()
    data["method"] = libmpm.Method(
        transfer=libmpm.Transfer(**transfer), kernel=kernel
    ).to_dict()
    other = libmpm.Scene.from_dict(data)
    if fbar is not None:
        bodies = [b | {"fbar": fbar.to_dict()} for b in data["bodies"]]
        other = libmpm.Scene.from_dict(data | {"bodies": bodies})
    for precision in ("single", "double"):
        sim = libmpm.Simulation(other, device="cuda", precision=precision, pipeline="phased")
        sim.step(int(sys.argv[1]) // 3)
        assert (sim.particles["water"]["position"] == sim.particles["water"]["position"]).all()
        print(transfer, kernel, precision, sim.time)
# Velocities that particles store in the fused step, of water and of a solid with F-bar, on a slope
# whose cells are linear.
data = scene.to_dict()
data["method"] = libmpm.Method(transfer=libmpm.Transfer(scheme="AFLIP", flip=0.95)).to_dict()
data["bodies"][1]["fbar"] = libmpm.FBar(form="two-volume", ratio=0.3).to_dict()
other = libmpm.Scene.from_dict(data)
slope = libmpm.shapes.HalfSpace(point=(0.25, 0, 0), normal=(0.4, 0, 1))
dry = libmpm.shapes.Difference(whole=scene.bodies[0].shape, without=slope)
other.replace("water", shape=dry)
other.add_boundary(name="slope", shape=slope, response=libmpm.boundaries.Slip())
sim = libmpm.Simulation(other, device="cuda", precision="single")
sim.step(int(sys.argv[1]))
assert (sim.particles["water"]["position"] == sim.particles["water"]["position"]).all()
print("AFLIP, F-bar on a solid, slope", sim.time, sim.pipeline)
# Surfaces that move and turn, mirrored planes, a pump, water that comes in and leaves.
flume = libmpm.Scene(
    dimension=3, cell_size=0.05, lower=(0, 0, 0), upper=(1.0, 0.2, 0.5), gravity=(0, 0, -9.81)
)
flume.add_body(
    name="water",
    shape=libmpm.shapes.Box(lower=(0, 0, 0), upper=(1.0, 0.2, 0.3)),
    material=libmpm.materials.TaitFluid(density=1000, bulk_modulus=1e5),
    velocity=(0.5, 0, 0),
    hydrostatic=0.3,
)
b = libmpm.boundaries
walls = libmpm.shapes.DomainWalls(faces=("y-", "y+", "z-"))
flume.add_boundary(name="walls", shape=walls, response=b.Mirror())
flume.add_boundary(
    name="ball",
    shape=libmpm.shapes.Sphere(centre=(0.5, 0.1, 0.42), radius=0.1),
    response=b.Separable(static_friction=0.2, dynamic_friction=0.1),
    motion=b.Travel((0.0, 0.0, -1.0)),
    rotation=b.Rotation(about=(0.5, 0.1, 0.42), rate=5.0, axis="y"),
)
flume.add_sensor(name="load", sensor=libmpm.sensors.LoadCell(boundary="ball", interval=1e-3))
flume.add_flow(name="in", flow=b.Inflow(body="water", face="x-", velocity=0.5, level=0.3))
flume.add_flow(name="out", flow=b.Outflow(face="x+", velocity=0.5))
for precision in ("single", "double"):
    sim = libmpm.Simulation(flume, device="cuda", precision=precision)
    sim.step(2 * int(sys.argv[1]))
    assert (sim.particles["water"]["position"] == sim.particles["water"]["position"]).all()
    print("flume", precision, sim.time, sim.inflow["in"].values[-1:])
SCENE
  for tool in ${LIBMPM_SANITIZE_TOOLS:-memcheck racecheck initcheck synccheck}; do
    echo "== $tool"
    timeout 200 compute-sanitizer --tool "$tool" --error-exitcode 9 --print-limit 20 \
      "$python" "$scene" "${LIBMPM_SANITIZE_STEPS:-60}" 2>&1 | tee "$results/sanitize-$tool.log"
    # Thousands of nearly empty blocks, whose particles go one by one.
    timeout 200 compute-sanitizer --tool "$tool" --error-exitcode 9 --print-limit 20 \
      "$python" benchmarks/one_gpu.py --cases lone --scale 0.01 --steps 10 2>&1 |
      tee "$results/sanitize-$tool-lone.log"
  done
}

bench() {
  local precision particles command
  for particles in ${LIBMPM_BENCH_SIZES:-100000 1000000 8000000}; do
    for precision in ${LIBMPM_BENCH_PRECISIONS:-single mixed double}; do
      command=("$python" -m libmpm bench --device cuda --precision "$precision"
        --particles "$particles" ${LIBMPM_BENCH:-} --json "$results/bench.jsonl")
      echo "== ${command[*]}"
      "${command[@]}" | tee "$results/bench-$precision-$particles.log"
    done
  done
  nvidia-smi --query-gpu=name,driver_version,clocks.sm,memory.total --format=csv >"$results/gpu.csv"
}

ranks() { # one scene on 1, 2, 4 ... of the devices that are here
  local devices case
  mapfile -t devices < <(nvidia-smi --query-gpu=index --format=csv,noheader | sed 's/^/cuda:/')
  nvidia-smi topo -m >"$results/topology.txt"
  "$python" -m pytest -q -p no:cacheprovider tests/python/test_ranks_gpu.py \
    2>&1 | tee "$results/ranks.log"
  for case in ${LIBMPM_RANK_CASES:-mixing weak strong large capacity}; do
    # One that fails does not keep the others from running.
    "$python" benchmarks/many_gpus.py --devices "${devices[@]}" --cases "$case" --fbar default \
      --seconds "${LIBMPM_RANK_SECONDS:-3}" --json "$results/many_gpus.jsonl" \
      2>&1 | tee "$results/ranks-$case.log" || echo "== $case failed"
  done
}

[ $# -gt 0 ] || { sed -n '2,17s/^# \{0,1\}//p' "$0"; exit 2; }
for part in "$@"; do
  case $part in
    build | test | sanitize | bench | ranks)
      start=$SECONDS
      "$part"
      echo "== $part: $((SECONDS - start)) s" | tee -a "$results/times.txt"
      ;;
    *) echo "unknown part: $part (build, test, sanitize, bench, ranks)" >&2; exit 2 ;;
  esac
done
