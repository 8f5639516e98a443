"""Claims of sources are run in their sources' own set-up: what `benchmarks/claims.py` builds.

Nothing is run. Expected duration: 10 s.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest

import libmpm
from libmpm import boundaries, shapes
from libmpm.methods import FBar, Kernel, Smoothing, Transfer

FOLDER = Path(__file__).resolve().parents[2] / "benchmarks"
SCRIPT = FOLDER / "claims.py"

pytestmark = pytest.mark.skipif(not SCRIPT.exists(), reason="needs the source tree")
if SCRIPT.exists():
    sys.path.insert(0, str(FOLDER))
    import bridges_scenes
    import claims
    import claims_scenes

    JOBS = {job.name: job for job in claims.jobs()}

#: The functions of Yang (2016), A.1 to A.5.
LINEAR = Kernel(name="linear", modified=True)


class Built(Exception):
    """The scene is there; it is not to be run."""


def scene_of(name: str) -> libmpm.Scene:
    """Return the scene that a run of the benchmark begins with."""
    found: list[libmpm.Scene] = []

    def made(scene: libmpm.Scene) -> Any:
        found.append(scene)
        raise Built

    with pytest.raises(Built):
        claims_scenes.RUNS[JOBS[name].scene](made, JOBS[name].parameters)
    return found[0]


def body(scene: libmpm.Scene, name: str) -> Any:
    """Return a body of a scene by its name."""
    return next(b for b in scene.bodies if b.name == name)


def response(scene: libmpm.Scene, name: str) -> Any:
    """Return how a boundary of a scene responds."""
    return next(b.response for b in scene.boundaries if b.name == name)


@pytest.mark.parametrize("density", [200.0, 400.0, 600.0])
def test_blocks_in_water_meet_a_deck_that_stays_where_it_is(density: float) -> None:
    """V13: one cell above still water, linear functions, FLIP, F0AL1, cells of 0.5 m."""
    scene = scene_of(f"V13 length=6.0 density={density}")
    deck = next(b.shape for b in scene.boundaries if b.name == "deck")
    assert isinstance(deck, shapes.Box)
    assert scene.cell_size == 0.5
    assert deck.lower == (16.0, 6.0 + scene.cell_size)
    assert scene.method.kernel_choice == LINEAR
    assert scene.transfer.scheme == "FLIP"
    water = body(scene, "flow")
    assert water.smoothing == Smoothing(method="F0AL1")
    assert water.fbar is None
    assert water.material.bulk_modulus == 2.2e9
    assert isinstance(response(scene, "deck"), boundaries.Slip)


@pytest.mark.parametrize("name", ["V7 M1", "V8 II", "V9 I B1", "V9 II B2"])
def test_bridges_have_the_sources_functions(name: str) -> None:
    """V7 to V9: linear functions, FLIP and F0AL1; what a block bears of it can be asked for."""
    scene = scene_of(f"{name} linear K=2.2e+06")
    assert scene.method.kernel_choice == LINEAR
    assert scene.transfer.scheme == "FLIP"
    assert body(scene, "water").smoothing == Smoothing(method="F0AL1")
    model = bridges_scenes.MODELS[name.split()[1]]
    if name.startswith(("V8", "V9 II")):
        assert model.soffit == pytest.approx(model.flume + model.cell)
    if "B" in name:
        (tracker,) = [s.sensor for s in scene.sensors if s.name == "block"]
        assert "boundary_force" in tracker.quantities
    scene.validate()


def test_dominoes_have_the_published_transfer() -> None:
    scene = scene_of("dominoes ASFLIP 4 cells 24 mm wide")
    transfer = scene.transfer
    assert (transfer.scheme, transfer.flip, transfer.shift_max) == ("ASFLIP", 0.999, 0.025)
    pieces = [b for b in scene.bodies if b.name.startswith("domino-")]
    assert len(pieces) == 24
    assert {b.particles_per_cell for b in pieces} == {27}
    assert scene.dimension == 3


def test_sloshing_is_between_smooth_walls_without_pressure_at_the_start() -> None:
    scene = scene_of("sloshing plane slip")
    assert response(scene, "walls") == boundaries.Slip(cell="held")
    assert scene.transfer == Transfer(scheme="AFLIP", flip=0.25)
    for water in scene.bodies:
        assert water.material.bulk_modulus == 2.2e9
        assert water.hydrostatic is None
        assert water.fbar == FBar(form="two-volume", ratio=0.25)


def test_the_elastic_column_is_the_sources_and_has_no_smoothing() -> None:
    scene = scene_of("elastic column 1 mm")
    column, water = body(scene, "column"), body(scene, "water")
    assert (column.material.density, column.material.poissons_ratio) == (1000.0, 0.3)
    assert water.material.bulk_modulus == 2.2e9
    assert water.fbar is None
    assert not isinstance(column.fbar, FBar)  # solids have none by default
    assert scene.transfer.flip == 0.8


def test_cubes_sink_in_water_of_its_own_modulus_without_pressure_at_the_start() -> None:
    scene = scene_of("buoyancy plane 12.5 mm")
    water = [b for b in scene.bodies if hasattr(b.material, "bulk_modulus")]
    assert water
    for part in water:
        assert part.material.bulk_modulus == 2.2e9
        assert part.hydrostatic is None
    assert scene.transfer.flip == 0.3


@pytest.mark.parametrize(
    ("name", "particles"),
    [
        ("sloshing 0.4 m wide 25 mm", 2_097_152),
        ("elastic column in space 1 mm", 4_184_832),
        # The source's cubes in cells of half the size have 33,554,432 with the basin of each.
        ("buoyancy in space 25 mm", 3 * 33_554_432 // 8),
        ("dominoes plane ASFLIP E=2e+09", 24 * 36 * 288),
    ],
)
def test_runs_have_the_particles_of_the_sources_table(name: str, particles: int) -> None:
    """Bonus (2023), table 6.3; what a tracker follows is where it should be."""
    scene = scene_of(name)
    assert scene.plan(device="cpu").particles == pytest.approx(particles, rel=0.003)
    if name.startswith("elastic"):
        (tracker,) = [s.sensor for s in scene.sensors if s.name == "tip"]
        assert tracker.body == "column"
        first = body(scene, "column").shape
        assert first.size == pytest.approx((0.012, 0.08, 0.012))
        # One below the other, both in the uppermost cell of the first layer: 24 a layer of depth.
        assert tracker.ids[1] - tracker.ids[0] == 24


def test_the_tip_of_the_column_is_followed() -> None:
    """Tracked particles lie on the left face, the upper half a distance below the top."""
    scene = scene_of("elastic column in space 4 mm")
    (tracker,) = [s.sensor for s in scene.sensors if s.name == "tip"]
    sim = libmpm.Simulation(scene, device="cpu")
    ids = sim.particles["column"]["id"]
    places = sim.particles["column"]["position"][[int((ids == i).argmax()) for i in tracker.ids]]
    assert places[:, 0] == pytest.approx(0.287)
    assert places[:, 1] == pytest.approx([0.077, 0.079])
    assert places[0, 2] == places[1, 2] == pytest.approx(0.006, abs=0.0011)


def test_what_did_not_end_is_marked() -> None:
    """Every line says whether it ended; one that did not says how far it came."""
    lines = [json.loads(line) for line in claims.RESULTS.read_text().splitlines()]
    assert {"V13", "bridges", *claims_scenes.RUNS} == {line["claim"] for line in lines}
    for line in lines:
        until = line["parameters"].get("until", line["parameters"].get("duration"))
        if until is not None:
            assert line["complete"] == (line["reached"] >= until), line["name"]
        assert line["complete"] or "reached" in line


def test_of_several_lines_of_a_run_the_furthest_counts() -> None:
    """Runs that go on from checkpoints leave a line for each piece."""
    pieces = [
        {"name": "a", "complete": False, "reached": 0.5},
        {"name": "b", "complete": True, "reached": 1.0},
        {"name": "a", "complete": False, "reached": 0.2, "error": "the clock"},
        {"name": "b", "complete": False, "reached": 0.1},
        {"name": "a", "complete": True, "reached": 1.0, "values": {"x": 1.0, "y": None}},
    ]
    found = claims.merged(pieces)
    assert [(x["name"], x["reached"]) for x in found] == [("a", 1.0), ("b", 1.0)]
    assert "x 1" in claims.table(found) and "partial" not in claims.table(found)
