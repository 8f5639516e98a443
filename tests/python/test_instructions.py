"""Passes compiled for several instruction sets agree to rounding; which one runs can be chosen."""

import os
import subprocess
import sys

import numpy as np
import pytest

from libmpm import _core

SCRIPT = """
import sys
import numpy as np
import libmpm
from libmpm import boundaries, materials, shapes
from libmpm.methods import Method, Transfer
precision, dimension, scheme, law, out, pipeline, kernel = sys.argv[1:]
d = int(dimension)
shifts = {"flip": 0.95, "shift_max": 0.3, "shift_min": 0.05, "critical_ratio": 1.0}
transfer = Transfer(scheme=scheme, **(shifts if scheme == "ASFLIP" else {}))
scene = libmpm.Scene(
    dimension=d, cell_size=0.05, lower=(0.0,) * d, upper=(0.6,) * d,
    gravity=(0.0,) * (d - 1) + (-9.81,),
    method=Method(transfer=transfer, kernel=kernel),
)
scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
material = {
    "fluid": materials.TaitFluid(bulk_modulus=1e5),
    "sand": materials.DruckerPrager(
        density=1600, youngs_modulus=1e6, poissons_ratio=0.3, friction_angle=30
    ),
}[law]
scene.add_body(
    name="body", material=material, shape=shapes.Box(lower=(0.0,) * d, upper=(0.3,) * d),
)
sim = libmpm.Simulation(scene, device="cpu", precision=precision, pipeline=pipeline)
sim.step(40)
body = sim.particles["body"]
order = np.argsort(body["id"])
np.save(out, np.concatenate([body[name][order] for name in ("position", "velocity")]))
"""


def levels():
    """The instruction sets of this processor that are below the one in use."""
    names = ["x86-64", "x86-64-v3", "x86-64-v4"]
    best = _core.build_info()["instruction_set"]
    if best not in names[1:]:
        pytest.skip(f"passes have one level here: {best}")
    return names[: names.index(best) + 1]


def run(level, *arguments):
    environment = {**os.environ, "LIBMPM_INSTRUCTIONS": level}
    return subprocess.run(
        [sys.executable, "-c", SCRIPT, *map(str, arguments)],
        env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("precision", "dimension", "scheme", "law", "pipeline", "kernel", "bound"),
    [
        ("double", 2, "APIC", "fluid", "fused", "quadratic", 1e-9),
        ("double", 3, "APIC", "sand", "fused", "quadratic", 1e-9),
        ("double", 3, "FLIP", "fluid", "fused", "quadratic", 1e-9),
        ("single", 3, "APIC", "fluid", "fused", "quadratic", 2e-3),
        ("double", 3, "APIC", "fluid", "two-pass", "quadratic", 1e-9),
        ("single", 2, "APIC", "sand", "two-pass", "quadratic", 2e-3),
        ("single", 3, "ASFLIP", "fluid", "phased", "quadratic", 2e-3),
        ("double", 3, "ASFLIP", "sand", "phased", "quadratic", 1e-9),
        ("double", 2, "XPIC", "sand", "phased", "quadratic", 1e-9),
        ("double", 2, "FLIP", "sand", "phased", "linear", 1e-9),
        ("double", 3, "FLIP", "sand", "phased", "cubic", 1e-9),
        ("double", 2, "FLIP", "sand", "phased", "ugimp", 1e-9),
        ("double", 3, "FLIP", "sand", "phased", "cpgimp", 1e-9),
    ],
)
def test_all_levels_agree(tmp_path, precision, dimension, scheme, law, pipeline, kernel, bound):
    found = []
    for level in levels():
        out = tmp_path / f"{level}.npy"
        done = run(level, precision, dimension, scheme, law, out, pipeline, kernel)
        assert done.returncode == 0, done.stderr
        found.append(np.load(out))
    assert np.abs(found[0]).max() > 0.1
    for other in found[1:]:
        assert np.abs(other - found[0]).max() < bound
        assert not np.array_equal(other, found[0]), "two levels ran the same instructions"


def test_a_level_that_is_not_there_is_refused_by_name():
    levels()
    done = run("x86-64-v9", "double", 2, "APIC", "fluid", "none.npy", "fused", "quadratic")
    assert done.returncode != 0
    for words in ("LIBMPM_INSTRUCTIONS", "x86-64-v9", "x86-64-v3", "leave it out"):
        assert words in done.stderr
