"""A guard notices bodies that are crushed and enter, or are entered by, what friction keeps out."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import libmpm
from libmpm import contacts, materials, shapes
from libmpm._src.output import checkpoint as checkpoints
from libmpm._src.run import guard_overlap
from libmpm._src.run.guard_overlap import crushed_bodies, deepest_entry, entered
from support import contact_scenes as cases
from support import jobs
from support.devices import device  # noqa: F401
from support.extremes import FOLDER

pytestmark = pytest.mark.skipif(not FOLDER.exists(), reason="needs the source tree")
if FOLDER.exists():
    from extremes_contact import squeezed

#: Steps in which `squeezed` gets to where it stays, and one look more.
STEPS = 2500


def start(scene: libmpm.Scene, **how: Any) -> libmpm.Simulation:
    return libmpm.Simulation(
        scene, **({"device": "cpu", "threads": 1, "precision": "single"} | how)
    )


def ends(simulation: libmpm.Simulation, steps: int = STEPS) -> str:
    with pytest.raises(libmpm.NumericalError) as caught:
        simulation.step(steps)
    return str(caught.value)


# The depth ----------------------------------------------------------------------------------------


def block(size: int, dimension: int) -> np.ndarray:
    """Return the particles of a block of so many cells an edge, 2^d a cell, in cells."""
    along = (np.arange(2 * size) + 0.5) / 2
    return np.stack(np.meshgrid(*[along] * dimension, indexing="ij"), -1).reshape(-1, dimension)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("overlap", [0.0, 0.25, 0.5, 0.7])
def test_depth_of_flat_faces(dimension, overlap):
    """That of the faces less a quarter of a cell, wherever they lie and however they are turned."""
    random = np.random.default_rng(1)
    for turned in (False, True) * 4:
        one = block(6, dimension) + random.uniform(0, 1, dimension)
        two = one.copy()
        two[:, -1] += 6 - overlap
        if turned:
            turn = np.linalg.qr(random.normal(size=(dimension, dimension)))[0]
            one, two = one @ turn.T + 20, two @ turn.T + 20
        for here, there in ((one, two), (two, one)):
            depth, k = deepest_entry(here, there, np.full(len(there), 0.5**dimension))
            assert depth == pytest.approx(overlap - 0.25, abs=0.06)
            assert 0 <= k < len(here)


def test_depth_counts_volumes_as_they_are():
    """A block pressed to half of its height has the depth of the block that it has become."""
    one, two = block(6, 2), block(6, 2)
    two[:, 1] = 5.6 + two[:, 1] / 2
    depth, k = deepest_entry(one, two, np.full(len(two), 0.125))
    assert depth == pytest.approx(0.15, abs=0.06)
    assert one[k, 1] == 5.75
    assert deepest_entry(one, two + np.array([0.0, 9.0]), np.full(len(two), 0.125)) == (-1.5, -1)


# What is named ------------------------------------------------------------------------------------


def test_a_block_that_is_crushed_is_named(tmp_path, device):  # noqa: F811
    simulation = start(squeezed(0.8).scene, device=device)
    text = ends(simulation)
    for part in (
        r"^body 'soft', particle \d+ at \(0\.\d+, 0\.\d+\) m: its middle lies 0\.(4|5)\d* cells "
        r"inside body '(below|above)', from which contact 'faces' keeps it apart, at step 2000, ",
        r"expected at most 0\.4 cells\. Body 'soft' has 0\.2\d of its volume left",
        r"Remedy: a stiffer 'soft', .* friction between the two .*Guard\(overlap=\.\.\.\)",
    ):
        assert re.search(part, text), text
    assert simulation.steps == 2000
    with pytest.raises(libmpm.NumericalError, match="its middle lies"):
        simulation.save_checkpoint(tmp_path / "x.npz")


def test_none_leaves_it_unwatched():
    simulation = start(squeezed(0.8).scene, guard=libmpm.Guard(overlap=None))
    simulation.step(STEPS)
    ratios = simulation.engine.condition(4096)["volume_ratio"]
    found = entered(simulation, ratios, 0)
    assert found is not None and found.depth > 0.4 and ratios[found.crushed] < 0.3
    with pytest.raises(libmpm.SceneError, match="Guard: overlap"):
        libmpm.Guard(overlap=0.0)


def test_a_checkpoint_is_looked_at_and_an_older_one_resumes(tmp_path):
    """What a run without the rule has saved is judged by the usual bound from then on."""
    simulation = start(squeezed(0.8).scene)
    simulation.step(1000)
    simulation.save_checkpoint(tmp_path / "good.npz")
    kept = checkpoints.load_checkpoint(tmp_path / "good.npz")
    del kept.header["guard"]["overlap"]
    checkpoints.save_checkpoint(tmp_path / "good.npz", kept)
    again = libmpm.Simulation.resume(tmp_path / "good.npz")
    assert again.guard == libmpm.Guard()
    assert ends(again) == ends(simulation)
    again = libmpm.Simulation.resume(tmp_path / "good.npz")
    again.step(999)  # between two looks
    with pytest.raises(libmpm.NumericalError, match=r"its middle lies .* at step 1999"):
        again.save_checkpoint(tmp_path / "bad.npz")
    assert not (tmp_path / "bad.npz").exists()


@pytest.mark.parametrize("ranks", [2, 4])
def test_ranks_say_the_same(ranks):
    texts = [
        ends(start(squeezed(0.8).scene, **how))
        for how in ({}, {"device": ["cpu"] * ranks, "threads": ranks})
    ]
    assert texts[0] == texts[1]


def test_processes_say_the_same(tmp_path):
    """One has the particles of both, all end in its words."""
    code = f"""
import sys
sys.path.insert(0, {str(FOLDER)!r})
import libmpm
from extremes_contact import squeezed
sim = libmpm.Simulation(
    squeezed(0.8).scene, device="cpu", threads=1, precision="single", ranks="processes")
try:
    sim.step({STEPS})
except libmpm.NumericalError as error:
    print(error)
"""
    alone = ends(start(squeezed(0.8).scene))
    told = jobs.well(jobs.run(2, code, tmp_path))
    assert [text.strip() for _, text, _ in told] == [alone, alone]


# What is not --------------------------------------------------------------------------------------


def bulging() -> libmpm.Scene:
    """Return a block that keeps most of its volume as it loses 0.8 of its height."""
    scene = squeezed(0.8).scene
    scene.replace("soft", material=cases.solid(1e6, 0.3))
    return scene


@pytest.mark.parametrize(
    ("make", "steps", "every"),
    [(lambda: squeezed(0.5).scene, 4000, 100), (bulging, 4000, 100), (cases.pile, 400, 20)],
    ids=["half", "bulging", "pile"],
)
def test_what_is_well_runs_on(make: Callable[[], libmpm.Scene], steps: int, every: int):
    start(make(), guard=libmpm.Guard(every=every)).step(steps)


def test_depth_alone_is_no_bound(monkeypatch):
    """Discs of a pile that holds are entered by half a cell for a moment."""
    monkeypatch.setattr(guard_overlap, "CRUSHED", 1.1)
    text = ends(start(cases.pile(), guard=libmpm.Guard(every=20)), 400)
    assert "'disc" in text and "cells inside body 'disc" in text


def test_nothing_is_read_unless_a_body_is_crushed(monkeypatch):
    def read(*_: Any) -> None:
        raise AssertionError("particles were read")

    simulation = start(squeezed(0.5).scene, guard=libmpm.Guard(every=100))
    monkeypatch.setattr(guard_overlap, "deepest_entry", read)
    monkeypatch.setattr(guard_overlap, "_particles", read)
    simulation.step(2200)
    assert simulation.engine.condition(4096)["volume_ratio"][0] < 0.55


def test_no_bit_depends_on_it(monkeypatch, device):  # noqa: F811
    looks = []
    monkeypatch.setattr(guard_overlap, "CRUSHED", 0.95)
    monkeypatch.setattr(
        guard_overlap, "deepest_entry", lambda *given: looks.append(1) or deepest_entry(*given)
    )
    states = []
    for guard in (None, libmpm.Guard(every=50)):
        simulation = start(squeezed(0.5).scene, guard=guard, device=device)
        simulation.step(620)
        states.append(simulation.engine.save())
    assert looks
    for name, array in states[0].items():
        assert array.tobytes() == states[1][name].tobytes(), name


@pytest.mark.filterwarnings("ignore::libmpm.ModelWarning")
def test_solids_of_particles_that_friction_meets_are_watched():
    """No fluid, whose law is another one; no body of elements; nothing that no friction names."""
    scene = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(4, 4))
    wet = materials.TaitFluid(bulk_modulus=1e5)

    def add(name: str, place: float, material: Any = None, mesh: bool = False) -> None:
        box = shapes.Box(lower=(place, 1.0), upper=(place + 0.5, 1.5))
        shape = shapes.Triangles.fill(solid=box, edge=0.1) if mesh else box
        scene.add_body(name=name, shape=shape, material=material or cases.solid())

    add("block", 0.0)
    add("mesh", 0.5, mesh=True)
    add("water", 1.0, wet)
    ratios = [0.1, 0.1, 0.1]
    assert crushed_bodies(scene, ratios) == []
    scene.add_contact(name="wet", between=("block", "water"), law=contacts.Fluid())
    assert crushed_bodies(scene, ratios) == []
    scene.add_contact(name="dry", between=("block", "mesh"), law=contacts.Friction())
    assert crushed_bodies(scene, ratios) == [0]
    assert crushed_bodies(scene, [0.41, 0.1, 0.1]) == crushed_bodies(scene, [np.nan] * 3) == []
    simulation = start(scene)
    # Beside it lie elements and water alone.
    assert entered(simulation, ratios, 0) is None


def test_many_bodies_come_in_turn(monkeypatch):
    """Each pair within as many looks as there are turns of both."""
    simulation = start(squeezed(0.8).scene, guard=None)
    simulation.step(STEPS)
    ratios = simulation.engine.condition(4096)["volume_ratio"]
    whole = entered(simulation, ratios, 0)
    monkeypatch.setattr(guard_overlap, "MOST", 1)
    found = [entered(simulation, ratios, look) for look in (6, 7, 8)]
    pairs = [{one.body, one.other} for one in found if one is not None]
    names = [body.name for body in simulation.scene.bodies]
    soft = names.index("soft")
    assert pairs == [{soft, names.index("below")}, {soft, names.index("above")}, pairs[0]]
    assert whole in found
