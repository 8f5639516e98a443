"""Bodies that differ in nothing but their particles are stepped as one and read as several."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

import libmpm
from support.devices import device  # noqa: F401 (a fixture)

STEPS = 60


def blocks(*, watched: bool, leaving: str = "stop") -> libmpm.Scene:
    """Three equal blocks with velocities of their own, and one of another stiffness.

    `watched`: an energy sensor on each keeps the engine from merging them.
    """
    scene = libmpm.Scene(
        dimension=2, cell_size=0.05, lower=(0, 0), upper=(4, 1), gravity=(0, -9.81),
        method=libmpm.Method(leaving=leaving),
    )  # fmt: skip
    for k in range(4):
        scene.add_body(
            name=f"block {k}",
            shape=libmpm.shapes.Box(lower=(0.25 + k, 0.3), upper=(0.45 + k, 0.5)),
            material=libmpm.materials.FixedCorotated(
                density=900, youngs_modulus=2e5 if k == 3 else 1e5, poissons_ratio=0.3
            ),
            particles_per_cell=4,
            velocity=(0.5 * k, 0.0),
        )
        if watched:
            scene.add_sensor(
                name=f"energy {k}", sensor=libmpm.sensors.Energy(interval=1, body=f"block {k}")
            )
    return scene


def test_one_pass_for_alike_bodies() -> None:
    kernels = [k for k in blocks(watched=False).plan(device="cpu").kernels if k.startswith("fused")]
    assert kernels == ["fused:block 0", "fused:block 3"]
    apart = [k for k in blocks(watched=True).plan(device="cpu").kernels if k.startswith("fused")]
    assert len(apart) == 4


@pytest.mark.parametrize("precision", ["single", "double"])
def test_merged_and_apart_agree(device: str, precision: str) -> None:  # noqa: F811
    together = libmpm.Simulation(blocks(watched=False), device=device, precision=precision)
    apart = libmpm.Simulation(blocks(watched=True), device=device, precision=precision)
    together.step(STEPS)
    apart.step(STEPS)
    bound = 1e-5 if precision == "single" else 1e-12
    for k in range(4):
        a, b = together.particles[f"block {k}"], apart.particles[f"block {k}"]
        assert len(a) == len(b) == 64
        first, second = np.argsort(a["id"]), np.argsort(b["id"])
        np.testing.assert_array_equal(a["id"][first], b["id"][second])
        assert a["id"].min() == 64 * k
        for name in ("position", "velocity", "deformation_gradient"):
            np.testing.assert_allclose(
                a[name][first], b[name][second], rtol=0, atol=bound * (1 + np.abs(b[name]).max())
            )
        drift = a["position"][:, 0].mean() - (0.35 + k)
        assert drift == pytest.approx(0.5 * k * together.time, abs=1e-4)


def test_removed_particles_go_to_their_bodies() -> None:
    scene = blocks(watched=False, leaving="delete")  # no walls: all fall out
    simulation = libmpm.Simulation(scene, device="cpu")
    with pytest.warns(libmpm.ModelWarning):
        simulation.run(until=0.6)
    counts = [len(simulation.particles[f"block {k}"]) for k in range(4)]
    assert counts == [0, 0, 0, 0]


def test_reads_are_of_the_state_as_it_stands() -> None:
    """What readers are given again without gathering it anew is never of an earlier step."""
    together = libmpm.Simulation(blocks(watched=False), device="cpu", precision="double")
    apart = libmpm.Simulation(blocks(watched=True), device="cpu", precision="double")
    for steps in (0, 1, STEPS):
        together.step(steps)
        apart.step(steps)
        for k in (2, 0, 1):
            a, b = together.particles[f"block {k}"], apart.particles[f"block {k}"]
            np.testing.assert_allclose(a["position"], b["position"], rtol=0, atol=1e-12)
            both = a.read(["stress", "velocity", "position"])
            np.testing.assert_allclose(both["velocity"], b["velocity"], rtol=0, atol=1e-12)
            np.testing.assert_array_equal(both["position"], a["position"])
            assert both["stress"].shape == (64, 2, 2)


def test_reads_while_particles_leave() -> None:
    scene = blocks(watched=False, leaving="delete")  # no walls: all fall out
    simulation = libmpm.Simulation(scene, device="cpu")
    fewest = [64] * 3
    for until in np.arange(0.2, 0.41, 0.02):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", libmpm.ModelWarning)
            simulation.run(until=until, progress=False)
        for k in range(3):
            view = simulation.particles[f"block {k}"]
            read = view.read(["id", "position"])
            assert len(read["id"]) == len(read["position"]) == len(view) <= fewest[k]
            assert ((read["id"] >= 64 * k) & (read["id"] < 64 * (k + 1))).all()
            fewest[k] = len(view)
    assert max(fewest) == 0


def test_resumed_to_the_same_bits(tmp_path: Path) -> None:
    whole = libmpm.Simulation(blocks(watched=False), device="cpu")
    whole.step(2 * STEPS)
    first = libmpm.Simulation(blocks(watched=False), device="cpu")
    first.step(STEPS)
    first.save_checkpoint(tmp_path / "state.npz")
    second = libmpm.Simulation.resume(tmp_path / "state.npz")
    second.step(STEPS)
    for k in range(4):
        np.testing.assert_array_equal(
            whole.particles[f"block {k}"]["position"], second.particles[f"block {k}"]["position"]
        )
