"""Bodies of elements of laws that flow: closed forms, bits, what is stored and refused."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import libmpm
from libmpm import SceneError, materials, shapes
from support import element_cases as cases
from support import element_load_cases as loads

#: So heavy that stresses move nothing: vertices go where their first speeds take them.
HEAVY: dict[str, Any] = {"density": 1e9, "youngs_modulus": 1e6, "poissons_ratio": 0.3}
BULK, SHEAR = 1e6 / (3 * 0.4), 1e6 / 2.6
STEP = 1e-3


def strained(
    d: int,
    law: Any,
    strain: float,
    steps: int = 1,
    precision: str = "double",
    volumes: str | None = None,
) -> tuple[Any, np.ndarray[Any, Any]]:
    """Return a run after uniaxial strain along x in equal steps, and which elements are inside.

    Nodes take a linear field exactly, so that one step is exact; in the next ones APIC's slopes are
    those of the step before.
    """
    scene = libmpm.Scene(dimension=d, cell_size=0.1, lower=(0,) * d, upper=(1.6, 1.2, 1.2)[:d],
                         method=libmpm.Method(time_step=STEP))  # fmt: skip
    mesh = cases.mesh_of((0.4,) * d, (1.2, 0.8, 0.8)[:d], 0.05, volumes=volumes)
    rate = strain / (steps * STEP)
    speed = libmpm.Field(components=(f"{rate!r} * (x - 0.8)", "0", "0")[:d])
    scene.add_body(name="block", shape=mesh, material=law, velocity=speed)
    sim = libmpm.Simulation(scene, device="cpu", precision=precision)
    sim.step(steps)
    middle = mesh.vertices[mesh.elements].mean(axis=1)
    inside = (np.abs(middle - np.array([0.8, 0.6, 0.6][:d])) < 0.15).all(axis=1)
    return sim, inside


def of_all(sim: Any, inside: np.ndarray[Any, Any], share: float) -> np.ndarray[Any, Any]:
    """Return the one stress of the elements inside, Pa."""
    stress = sim.particles["block"]["element_stress"][inside]
    assert np.ptp(stress, axis=0).max() < share * np.abs(stress).max()
    return np.asarray(stress.mean(axis=0))


@pytest.mark.parametrize(("precision", "steps", "share"), [
    ("double", 1, 1e-6), ("double", 20, 1e-3), ("single", 20, 1e-3),
])  # fmt: skip
@pytest.mark.parametrize("volumes", ["element", "vertex"])
@pytest.mark.parametrize("d", [2, 3])
def test_von_mises_in_uniaxial_strain(
    d: int, volumes: str, precision: str, steps: int, share: float
) -> None:
    """τ_11 = K ln λ + 2/3 (σ_y + H a), a = (2 G ln λ - σ_y) / (3 G + H)."""
    yields, h = 1e4, 2e5
    law = materials.VonMises(**HEAVY, yield_stress=yields, hardening_modulus=h)
    sim, inside = strained(d, law, 0.05, steps, precision, volumes)
    along = math.log(1.05)
    flowed = (2 * SHEAR * along - yields) / (3 * SHEAR + h)
    tau = BULK * along + 2 / 3 * (yields + h * flowed)
    across = BULK * along - 1 / 3 * (yields + h * flowed)
    stress = of_all(sim, inside, share)
    assert stress[0, 0] == pytest.approx(tau / 1.05, rel=share)
    assert stress[1, 1] == pytest.approx(across / 1.05, rel=share)
    view = sim.particles["block"]
    assert view["element_plastic_strain"][inside] == pytest.approx(flowed, rel=share)
    assert view["plastic_strain"].max() > 0.9 * flowed


@pytest.mark.parametrize("d", [2, 3])
def test_drucker_prager_in_uniaxial_compression(d: int) -> None:
    """p = -K ln λ, |s| = 3 α p without cohesion and dilatancy."""
    law = materials.DruckerPrager(**HEAVY, friction_angle=20.0)
    sim, inside = strained(d, law, -0.04)
    along = math.log(0.96)
    # In plane strain the cone is another one, as for particles.
    sine = math.sin(math.radians(law.core_parameters(d)["friction_angle"]))
    pressure = -BULK * along
    size = math.sqrt(2 / 3) * 6 * sine / (3 - sine) * pressure
    assert size < 2 * SHEAR * math.sqrt(2 / 3) * abs(along)  # it yields
    stress = of_all(sim, inside, 1e-6)
    assert stress[0, 0] == pytest.approx(-(pressure + math.sqrt(2 / 3) * size) / 0.96, rel=1e-6)
    assert stress[1, 1] == pytest.approx(-(pressure - size / math.sqrt(6)) / 0.96, rel=1e-6)


@pytest.mark.parametrize("d", [2, 3])
def test_what_does_not_yield_is_hencky_to_the_bit_but_rounding(d: int) -> None:
    """Below yield the law is StVenantKirchhoffHencky's, after hundreds of steps."""
    common = {"density": 1000.0, "youngs_modulus": 1e5, "poissons_ratio": 0.3}
    mesh = cases.mesh_of((0.2, 0.15, 0.15)[:d], (0.8, 0.45, 0.45)[:d], 0.05, volumes="element")
    found = []
    for law in (materials.VonMises(**common, yield_stress=1e9),
                materials.StVenantKirchhoffHencky(**common)):  # fmt: skip
        scene = cases.small_scene(d, shape=mesh, material=law)
        sim = libmpm.Simulation(scene, device="cpu", precision="double")
        sim.step(300)
        found.append(sim.particles["block"].read(["position", "element_stress"]))
    assert found[0]["position"] == pytest.approx(found[1]["position"], abs=1e-10)
    assert np.abs(found[0]["element_stress"]).max() > 100
    assert found[0]["element_stress"] == pytest.approx(found[1]["element_stress"], abs=1e-4)


def yielding(d: int = 2, **body: Any) -> libmpm.Scene:
    """Return a block that flies into a corner and yields there."""
    law = materials.VonMises(density=1000.0, youngs_modulus=1e5, poissons_ratio=0.3,
                             yield_stress=2e3, hardening_modulus=1e4)  # fmt: skip
    return cases.small_scene(d, **({"material": law} | body))


@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize("d", [2, 3])
def test_a_resumed_run_has_the_same_bits(d: int, precision: str, tmp_path: Path) -> None:
    scene = yielding(d)
    whole = cases.after(scene, 200, precision=precision, threads=1)
    assert whole["block/element_plastic_strain"].max() > 0.01
    two = cases.after(scene, 200, precision=precision, threads=2)
    sim = libmpm.Simulation(scene, device="cpu", precision=precision)
    sim.step(120)
    assert sim.particles["block"]["element_plastic_strain"].max() > 0
    sim.save_checkpoint(tmp_path / "half.npz")
    again = libmpm.Simulation.resume(tmp_path / "half.npz", device="cpu")
    again.step(80)
    for key, array in cases.state_of(again).items():
        assert np.array_equal(array, whole[key]) and np.array_equal(array, two[key]), key


def test_copies_are_stepped_as_one_and_keep_what_is_theirs(tmp_path: Path) -> None:
    """Two bars, one of which strikes: of merged bodies each has its elements' own memory."""
    law = materials.VonMises(density=1000.0, youngs_modulus=1e5, poissons_ratio=0.3,
                             yield_stress=1e3)  # fmt: skip
    scene = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(4, 1.6))
    for k, speed in enumerate((-3.0, 0.0)):
        low = (0.3 + 2.0 * k, 0.5)
        scene.add_body(name=f"b{k}", shape=cases.mesh_of(low, (low[0] + 0.5, 0.9), 0.05),
                       material=law, velocity=(speed, 0.0))  # fmt: skip
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(),
                       response=libmpm.boundaries.Separable())  # fmt: skip
    sim = libmpm.Simulation(scene, device="cpu", precision="double")
    sim.step(150)
    assert sim.particles["b0"]["element_plastic_strain"].max() > 0.01
    assert sim.particles["b1"]["element_plastic_strain"].max() == 0
    sim.save_checkpoint(tmp_path / "x.npz")
    again = libmpm.Simulation.resume(tmp_path / "x.npz", device="cpu")
    assert np.array_equal(again.particles["b0"]["element_plastic_strain"],
                          sim.particles["b0"]["element_plastic_strain"])  # fmt: skip


@pytest.mark.parametrize("change", ["none", "size", "infinite"])
def test_a_state_without_what_elements_keep_is_refused(change: str, tmp_path: Path) -> None:
    sim = libmpm.Simulation(yielding(), device="cpu", precision="double")
    sim.step(50)
    state = dict(sim.engine.save())
    entry = state["body0_elements"]
    if change == "none":
        del state["body0_elements"]
    elif change == "size":
        state["body0_elements"] = entry[:-1]
    else:
        state["body0_elements"] = np.full_like(entry, np.inf)
    with pytest.raises(SceneError, match="body0_elements"):
        sim.engine.load(state)


def test_what_is_refused() -> None:
    sand = materials.DruckerPrager(density=1600.0, youngs_modulus=1e6, poissons_ratio=0.45)
    with pytest.raises(SceneError, match="volumes are the vertices', of DruckerPrager"):
        yielding(material=sand).validate()
    mesh = cases.mesh_of((0.2, 0.15), (0.8, 0.45), 0.05, volumes="element")
    yielding(material=sand, shape=mesh).validate()
    for name, said in (("yields", "does not store it"), ("logJp", "stores no logarithm")):
        scene = yielding(material=sand, shape=mesh)
        scene.add_sensor(name="s", sensor=libmpm.sensors.ParticleSensor(
            body="block", attribute=name, operation="max", interval=0.1))  # fmt: skip
        with pytest.raises(SceneError, match=said):
            scene.validate()
    scene = cases.small_scene(2)
    sensor = libmpm.sensors.ParticleSensor(
        body="block", attribute="element_plastic_strain", operation="max", interval=0.1
    )
    scene.add_sensor(name="s", sensor=sensor)
    with pytest.raises(SceneError, match="does not store it"):
        scene.validate()


def test_a_sensor_of_plastic_strain() -> None:
    scene = yielding()
    sensor = libmpm.sensors.ParticleSensor(
        body="block", attribute="element_plastic_strain", operation="max", interval=0.02
    )
    scene.add_sensor(name="s", sensor=sensor)
    sim = libmpm.Simulation(scene, device="cpu", precision="double")
    sim.run(until=0.3, progress=False)
    values = sim.sensors["s"].values[:, 0]
    assert values[0] == 0 and values[-1] > 0.01 and (np.diff(values) >= -1e-12).all()


@pytest.mark.validation
@pytest.mark.parametrize("hardening", [0.0, 0.2])
def test_a_bar_that_yields(hardening: float) -> None:
    """Uniaxial stress in space: the plateau, and the line of hardening."""
    found = loads.yielding_bar(cells=2, hardening=hardening)
    assert found["force"] == pytest.approx(1, abs=0.04)


def test_an_element_beyond_the_range_of_its_law_is_named() -> None:
    """Blown up to 20 times its volume, of which a law at constant plastic volume has all."""
    law = materials.VonMises(density=1000.0, youngs_modulus=1.0, poissons_ratio=0.3,
                             yield_stress=1.0)  # fmt: skip
    scene = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(2, 2))
    scene.add_body(name="block", shape=cases.mesh_of((0.9, 0.9), (1.1, 1.1), 0.05), material=law,
                   velocity=libmpm.Field(components=("4 * (x - 1)", "4 * (y - 1)")))  # fmt: skip
    sim = libmpm.Simulation(scene, device="cpu", precision="double")
    with pytest.raises(libmpm.NumericalError, match=r"body 'block', vertices .*beyond the range of"
                       r" its law.*element \d+ of vertices"):  # fmt: skip
        sim.run(until=2.0, progress=False)
