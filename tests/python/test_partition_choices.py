"""Ranks begin where they are asked to, and loads may go by measured time; no bit depends on it.

Expected duration: 8 s.
"""

from __future__ import annotations

import numpy as np
import pytest

import libmpm
from libmpm import Partition, boundaries, materials, shapes
from libmpm._src.cli import main
from python import fake_engine
from support import jobs

HEAD = """
import os
import numpy as np
import libmpm
from libmpm import Partition
from python import fake_engine
"""

CELL = 0.05
#: m; of 8 x 8 cells.
BLOCK = 8 * CELL
#: Water to the left of two stacks of crates, and the ranks that each is to begin on.
APART = (("water",), ("crate-1", "crate-2"))


def flume():
    """A column of water that runs against two soft crates, 12 blocks long and 4 high."""
    scene = libmpm.Scene(
        dimension=2, cell_size=CELL, lower=(1.0, 0.0), upper=(1.0 + 12 * BLOCK, 4 * BLOCK),
        origin=(100.0, 0.0), gravity=(0.0, -9.81),
    )  # fmt: skip
    scene.add_body(
        name="water",
        shape=shapes.Box(lower=(1.0, 0.0), upper=(2.2, 1.2)),
        material=materials.TaitFluid(bulk_modulus=1e5),
    )
    for k in (1, 2):
        scene.add_body(
            name=f"crate-{k}",
            shape=shapes.Box(lower=(2.3 + 0.5 * k, 0.0), upper=(2.7 + 0.5 * k, 0.4)),
            material=materials.FixedCorotated(
                density=500.0, youngs_modulus=1e5, poissons_ratio=0.3
            ),
        )
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
    return scene


def simulate(ranks, partition=None):
    device = "cpu" if ranks == 1 else ["cpu"] * ranks
    return libmpm.Simulation(flume(), device=device, threads=ranks, partition=partition)


def same(a, b):
    """Tell whether two simulations hold the same bits of particles, whatever their order."""
    assert (a.time, a.steps) == (b.time, b.steps)
    for body in a.particles:
        x, y = a.particles[body], b.particles[body]
        first, second = np.argsort(x["id"]), np.argsort(y["id"])
        for name in ("id", "position", "velocity", "stress"):
            assert (x[name][first] == y[name][second]).all(), (body, name)
    return True


@pytest.fixture(scope="module")
def one():
    sim = simulate(1)
    sim.run(until=0.3, progress=False)
    return sim


def first_ranks(sim, body):
    """Return x of a body's particles, which come rank by rank."""
    return sim.particles[body]["position"][:, 0]


PLANES = {2: (2.2,), 3: (1.7, 2.6), 4: (1.4, 1.8, 3.5)}


@pytest.mark.parametrize("ranks", [2, 3, 4])
@pytest.mark.parametrize("limit", [None, 1.05])
def test_planes_at_given_places(one, ranks, limit):
    """The bits of one rank, on planes that stay and on planes that move."""
    many = simulate(ranks, Partition(cuts="x", at=PLANES[ranks], rebalance_above=limit))
    many.run(until=0.3, progress=False)
    assert many.statistics["migrated"] > 0
    assert (many.statistics["rebalances"] == 0) == (limit is None)
    assert same(one, many)


@pytest.mark.parametrize(("place", "border"), [(1.5, 1.4), (1.59, 1.4), (1.61, 1.8), (2.0, 1.8)])
def test_planes_are_at_the_nearest_border(place, border):
    """Of particles that come rank by rank, the first stand before the border."""
    sim = simulate(2, Partition(cuts="x", at=[place], rebalance_above=None))
    x = first_ranks(sim, "water") - 100.0
    before = int((x < border).sum())
    assert 0 < before < len(x)
    assert (x[:before] < border).all()


@pytest.mark.parametrize("cuts", [None, "x", "curve"])
def test_groups_of_bodies(one, cuts):
    """The bits of one rank; apart at the start where the row can have it so."""
    many = simulate(2, Partition(cuts=cuts, by=APART, rebalance_above=None))
    if cuts != "curve":
        # A plane through the gap: what one rank has is all of the water.
        assert many.statistics["shared_blocks"] > 0
        alone = simulate(2, Partition(cuts="x", at=[2.6], rebalance_above=None))
        for body in many.particles:
            assert (first_ranks(many, body) == first_ranks(alone, body)).all()
    many.run(until=0.3, progress=False)
    assert many.statistics["rebalances"] == 0
    assert same(one, many)


@pytest.mark.parametrize(
    ("ranks", "by"), [(3, "body"), (2, "material"), (3, (("crate-2",), ("water",), ("crate-1",)))]
)
def test_by_names_of_kinds(one, ranks, by):
    """Bodies, materials and groups in any order; then cuts move with the load."""
    many = simulate(ranks, Partition(by=by))
    many.run(until=0.3, progress=False)
    assert same(one, many)


@pytest.mark.parametrize("ranks", [2, 3, 4])
def test_loads_by_measured_time(one, ranks):
    """Clocks move cuts and nothing else."""
    for limit in (0, 1.2):
        many = simulate(ranks, Partition(weights="measured", rebalance_above=limit))
        many.run(until=0.3, progress=False)
        assert many.statistics["imbalance"] >= 1
        assert same(one, many)


def test_processes(tmp_path):
    """Ranks that are processes begin and go on alike."""
    code = """
        scene = fake_engine.small_scene()
        x = 0.5 * (scene.lower[0] + scene.upper[0])
        names = [body.name for body in scene.bodies]
        choices = [Partition(cuts="x", at=[x], rebalance_above=None), Partition(by="body"),
                   Partition(weights="measured", rebalance_above=0)]
        for k, partition in enumerate(choices):
            sim = libmpm.Simulation(
                scene, device="cpu", ranks="processes", threads=1, partition=partition)
            sim.step(60)
            for body in names:
                all_of = sim.gather(body, "position", "stress")
                if sim.rank == 0:
                    np.savez(os.path.join(os.environ["FOLDER"], f"{body}-{k}.npz"), **all_of)
    """
    jobs.well(jobs.run(2, jobs.script(HEAD, code), tmp_path))
    alone = libmpm.Simulation(fake_engine.small_scene(), device="cpu", threads=1)
    alone.step(60)
    found = sorted(tmp_path.glob("*.npz"))
    assert len(found) == 3 * len(alone.particles)
    for file in found:
        own = alone.gather(file.stem.rpartition("-")[0], "position", "stress")
        told = np.load(file)
        for name in own:
            assert (told[name] == own[name]).all(), (file.name, name)


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"at": (1.5,)}, "at is .*cuts is None; planes lie across an axis; use cuts='x', 'y'"),
        ({"at": (1.5,), "cuts": "curve"}, "at is .*cuts is 'curve'; planes lie across an axis"),
        ({"at": (3, 1.5), "cuts": "x"}, r"at\[1\] is 1.5 m behind 3 m; expected ascending"),
        ({"at": (3, 3), "cuts": "x"}, r"at\[1\] is 3 m behind 3 m; expected ascending"),
        ({"at": (), "cuts": "x"}, r"at is \(\); expected places in m"),
        ({"at": 1.5, "cuts": "x"}, r"at is 1.5; expected places in m"),
        ({"at": ("1",), "cuts": "x"}, r"at\[0\] is '1'; expected a number in m"),
        ({"at": (float("inf"),), "cuts": "x"}, r"at\[0\] is inf; expected a finite number m"),
        ({"at": (1.5,), "cuts": "x", "by": "body"}, "at and by both .*leave one out"),
        ({"by": "bodies"}, "by is 'bodies'; did you mean 'body'"),
        ({"by": ("water", "crate")}, "by is .*expected 'body', 'material', or the names"),
        ({"by": (("water",), ())}, "by is .*expected 'body', 'material', or the names"),
        ({"by": (("a",), ("a", "b"))}, "by names the body 'a' 2 times; expected once"),
        ({"weights": "time"}, "weights is 'time'; choose from particles, measured"),
    ],
)
def test_errors(given, text):
    with pytest.raises(libmpm.SceneError, match=f"^Partition: {text}"):
        Partition(**given)


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"at": (2, 3)}, "at has 2 places and there are 2 ranks; .*one place fewer.*; give 1"),
        ({"at": (0.9,)}, r"at\[0\] is 0.9 m and the domain from 1 to 5.8 m along 'x'; .*inside"),
        (
            {"at": (6,)},
            r"at\[0\] is 6 m .*; expected a place inside it; borders .* every 0.4 m from 1.4",
        ),
        ({"at": (1.1,)}, r"at\[0\] is 1.1 m, nearest to an end of the domain"),
        ({"at": (5.7,)}, r"at\[0\] is 5.7 m, nearest to an end of the domain"),
        ({"by": "body"}, "by='body' makes 3 groups and there are 2 ranks; expected one for each"),
        ({"by": (("water", "crate-1", "crate-2"),)}, "by makes 1 groups and there are 2 ranks"),
        ({"by": (("water",), ("crate-1", "crate-3"))}, "by names the body 'crate-3'; did you"),
        ({"by": (("water",), ("crate-1",))}, "by does not name the body 'crate-2'; expected all"),
    ],
)
def test_what_does_not_fit_the_scene(given, text):
    with pytest.raises(libmpm.SceneError, match=f"Partition: {text}"):
        simulate(2, Partition(**({"cuts": "x"} | given)))


def test_planes_at_one_border():
    with pytest.raises(libmpm.SceneError, match=r"at\[1\] is 1.5 m, nearest to the same border"):
        simulate(3, Partition(cuts="x", at=(1.4, 1.5)))
    # One process that its launcher has left alone cuts nothing.
    libmpm.Simulation(
        flume(), device="cpu", ranks="processes", partition=Partition(cuts="x", at=(2, 3))
    )


def test_resumed(one, tmp_path):
    """A run goes on from its planes or groups again; on another number it has to be told."""
    planes = Partition(cuts="x", at=(1.7, 2.6), rebalance_above=None)
    begun = simulate(3, planes)
    begun.run(until=0.15, progress=False)
    file = tmp_path / "three.npz"
    begun.save_checkpoint(file)
    groups = Partition(by="body", rebalance_above=None)
    measured = Partition(cuts="curve", weights="measured")
    for how, wanted in (
        ({}, planes),
        ({"partition": groups}, groups),
        ({"partition": measured, "device": ["cpu"] * 4}, measured),
        ({"device": "cpu"}, None),
    ):
        sim = libmpm.Simulation.resume(file, **how)
        assert sim.partition == wanted
        if wanted == planes:
            # Those within a cell of the plane may have crossed it since the last sort.
            x = first_ranks(sim, "water") - 100.0
            sure = x[abs(x - 1.8) > CELL]
            first = int((sure < 1.8).sum())
            assert 0 < first < len(sure)
            assert (sure[:first] < 1.8).all()
        sim.run(until=0.3, progress=False)
        assert same(one, sim)
    with pytest.raises(libmpm.SceneError, match="at has 2 places and there are 2 ranks"):
        libmpm.Simulation.resume(file, device=["cpu", "cpu"])


def test_a_value():
    """Values go through files."""
    for partition in (
        Partition(cuts="y", at=[1, 2.5]),
        Partition(by=[["water"], ["a", "b"]], weights="measured"),
        Partition(by="material"),
    ):
        assert Partition.from_dict(partition.to_dict()) == partition
    assert Partition(cuts="y", at=np.array([1.0])).at == (1.0,)


def test_command_line(tmp_path, capsys):
    flume().save(tmp_path / "scene.json")
    out = tmp_path / "out"
    how = ["--until", "0.01", "--no-picture", "--quiet", "--device", "cpu,cpu", "--threads", "2"]
    run = ["run", str(tmp_path / "scene.json"), "-o", str(out), *how]
    assert main([*run, "--cuts", "x", "--at", "0.5"]) == 2
    assert "inside it" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main([*run, "--cuts", "x", "--at", "left"])
    assert "'left'; expected places in m, such as 1.5,3.0" in capsys.readouterr().err
    assert main([*run, "--cuts", "x", "--at", "2.2", "--wall-limit", "0"]) == 6
    assert libmpm.Simulation.resume(out).partition == Partition(cuts="x", at=(2.2,))
    resume = ["resume", str(out), "--until", "0.01", "--no-picture", "--quiet"]
    assert main([*resume, "--by", "material", "--weights", "measured"]) == 0
