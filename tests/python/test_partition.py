"""How ranks are cut is the user's choice, and changes no bit.

Expected duration: 5 s.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

import libmpm
from libmpm import Partition, boundaries, materials, shapes
from libmpm._src.cli.commands import main
from python import fake_engine

CELL = 0.05
#: Linear cells add a block beyond planes along a wall: what is counted here is without.
HELD = boundaries.Slip(cell="held")
#: Blocks of 8 x 8 cells along the axes of the flume.
ACROSS, UP = 12, 4
WHOLE = (ACROSS * 8 * CELL, UP * 8 * CELL)


def flume(filled=(1.2, 1.2)):
    """A column of water that collapses in a flat flume, or fills it."""
    scene = libmpm.Scene(
        dimension=2, cell_size=CELL, lower=(0.0, 0.0), upper=WHOLE, gravity=(0.0, -9.81)
    )
    scene.add_body(
        name="water",
        shape=shapes.Box(lower=(0.0, 0.0), upper=filled),
        material=materials.TaitFluid(bulk_modulus=1e5),
    )
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=HELD)
    return scene


def simulate(ranks, partition=None, scene=None):
    device = "cpu" if ranks == 1 else ["cpu"] * ranks
    return libmpm.Simulation(scene or flume(), device=device, threads=ranks, partition=partition)


def same(a, b):
    """Tell whether two simulations hold the same bits of particles, whatever their order."""
    assert (a.time, a.steps) == (b.time, b.steps)
    x, y = a.particles["water"], b.particles["water"]
    first, second = np.argsort(x["id"]), np.argsort(y["id"])
    for name in ("id", "position", "velocity", "stress"):
        assert (x[name][first] == y[name][second]).all(), name
    return True


@pytest.mark.parametrize("ranks", [2, 3])
@pytest.mark.parametrize("cuts", ["x", "y", "curve", None])
def test_bits_of_one(ranks, cuts):
    """Any cuts, and cuts that move at every sort or never."""
    one = simulate(1)
    one.run(until=0.4, progress=False)
    for limit in (0, None) if ranks == 3 else (1.05,):
        many = simulate(ranks, Partition(cuts=cuts, rebalance_above=limit))
        many.run(until=0.4, progress=False)
        assert many.statistics["migrated"] > 0
        assert same(one, many)


@pytest.mark.parametrize("ranks", [2, 3])
def test_planes_lie_across_their_axis(ranks):
    """Of a full flume the two layers of blocks beside a plane are on two ranks.

    Tables reach one block beyond the domain on either side.
    """
    shared = {}
    for cuts in ("x", "y", "curve", None):
        sim = simulate(ranks, Partition(cuts=cuts), flume(WHOLE))
        sim.step(1)
        shared[cuts] = sim.statistics["shared_blocks"]
    layers = 2 * (ranks - 1)
    # Each rank counts the blocks that it shares.
    assert shared["x"] == 2 * layers * (UP + 2)
    assert shared["y"] == 2 * layers * (ACROSS + 2)
    # Left alone, the shorter cuts are taken.
    assert shared[None] == shared["x"] <= shared["curve"]


def test_when_cuts_move():
    """At 0 loads are even to half a block after every sort; at a huge limit cuts stay."""
    limits = (0, 1.05, 1e9, None)
    runs = [simulate(2, Partition(cuts="curve", rebalance_above=limit)) for limit in limits]
    uneven = []
    for _ in range(200):
        for sim in runs:
            sim.step(1)
        uneven.append([sim.statistics["imbalance"] for sim in runs])
    always, usual, huge, never = np.array(uneven).T
    # Of a row of weights the cut is nearest to its middle, so at most half the heaviest is amiss.
    # A block at rest has 4 particles a cell and 16 for itself; those here are up to 9 % denser.
    place = np.floor(runs[0].particles["water"]["position"] / (8 * CELL))
    blocks = np.unique(place, axis=0, return_counts=True)[1]
    assert blocks.max() < 1.09 * 256
    half = 0.5 * (1.09 * 256 + 16) / (0.5 * (blocks.sum() + 16 * 6))
    assert (always <= 1 + half).all()
    assert np.mean(always) < np.mean(usual) < np.mean(huge)
    assert (huge == never).all() and huge.max() > 1.5
    moved = [sim.statistics["rebalances"] for sim in runs]
    assert moved[0] > 2 * moved[1] > 0 == moved[2] == moved[3]


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"cuts": "X"}, "cuts is 'X'; expected an axis.*'curve', or None"),
        ({"cuts": 0}, "cuts is 0; expected an axis"),
        ({"rebalance_above": 0.9}, "rebalance_above is 0.9.*expected ≥ 1, or 0; use 1"),
        ({"rebalance_above": -1}, "rebalance_above is -1; expected ≥ 0"),
        ({"rebalance_above": math.nan}, "rebalance_above is nan"),
        ({"rebalance_above": "never"}, "rebalance_above is 'never'; expected a number"),
        ({"cut": "x"}, "unknown argument 'cut'; did you mean 'cuts'"),
    ],
)
def test_errors(given, text):
    with pytest.raises(libmpm.SceneError, match=f"^Partition: {text}"):
        Partition(**given)


def test_what_does_not_fit_the_scene():
    """One rank has nothing to cut, and a flat scene no third axis."""
    for device in ("cpu", ["cpu"]):
        with pytest.raises(libmpm.SceneError, match=r"on one device, 'cpu'.*\['cpu', 'cpu'\], or"):
            libmpm.Simulation(flume(), device=device, partition=Partition())
    pair = ["cpu", "cpu"]
    with pytest.raises(libmpm.SceneError, match=r"'z' in a scene of 2 .*use 'x' or 'y', 'curve'"):
        libmpm.Simulation(flume(), device=pair, partition=Partition(cuts="z"))
    libmpm.Simulation(fake_engine.small_scene(), device=pair, partition=Partition(cuts="z"))
    with pytest.raises(libmpm.SceneError, match=r"partition is 'x'; expected Partition\("):
        libmpm.Simulation(flume(), device=pair, partition="x")


def test_a_value():
    """Values go through files; both ways to say "never" are one."""
    never = Partition(cuts="y", rebalance_above=math.inf)
    assert never == Partition(cuts="y", rebalance_above=None)
    for partition in (never, Partition()):
        assert Partition.from_dict(partition.to_dict()) == partition
    assert simulate(2).partition is None
    assert simulate(2, never).partition == never


def test_resumed(tmp_path):
    """A run goes on with its cuts, with others, or without on one rank; the bits are the same."""
    one = simulate(1)
    one.run(until=0.3, progress=False)
    begun = simulate(3, Partition(cuts="y", rebalance_above=None))
    begun.run(until=0.15, progress=False)
    file = tmp_path / "three.npz"
    begun.save_checkpoint(file)
    found = []
    for how, wanted in (
        ({}, begun.partition),
        ({"device": ["cpu", "cpu"]}, begun.partition),
        ({"partition": Partition(cuts="x")}, Partition(cuts="x")),
        ({"partition": None}, None),
        ({"device": "cpu"}, None),
    ):
        sim = libmpm.Simulation.resume(file, **how)
        assert sim.partition == wanted
        sim.run(until=0.3, progress=False)
        assert same(one, sim)
        found.append(sim.statistics.get("rebalances"))
    assert found[:2] == [0, 0]
    with pytest.raises(libmpm.SceneError, match="on one device"):
        libmpm.Simulation.resume(file, device="cpu", partition=Partition())


def test_command_line(tmp_path, capsys):
    """`run` takes several devices and their cuts; `resume` goes on with them."""
    scene = flume()
    scene.save(tmp_path / "scene.json")
    out = tmp_path / "out"
    how = ["--until", "0.01", "--no-picture", "--quiet"]
    run = ["run", str(tmp_path / "scene.json"), "-o", str(out), *how]
    assert main([*run, "--device", "cpu", "--cuts", "x"]) == 2
    assert "on one device" in capsys.readouterr().err
    assert main([*run, "--device", "cpu,cpu", "--cuts", "z"]) == 2
    assert "in a scene of 2 dimensions" in capsys.readouterr().err
    several = ["--device", "cpu,cpu", "--threads", "2", "--rebalance-above", "inf"]
    assert main([*run, *several, "--wall-limit", "0"]) == 6
    assert libmpm.Simulation.resume(out).partition == Partition(rebalance_above=None)
    assert main(["resume", str(out), "--cuts", "curve", *how]) == 0


def test_study(tmp_path):
    """Options of a study name them; cases are the same whatever they are."""
    cells = []
    for cuts in ("x", "curve"):
        study = libmpm.Study(
            tmp_path / cuts, lambda width: flume((width, 1.2)), rows=[{"width": 1.2}], until=0.01,
            options={"device": ["cpu", "cpu"], "threads": 2, "partition": Partition(cuts=cuts)},
        )  # fmt: skip
        study.run(workers=0, progress=False)
        (case,) = study.cases
        assert case.status == "finished", case
        cells.append(case.folder.name)
    assert cells[0] == cells[1]
