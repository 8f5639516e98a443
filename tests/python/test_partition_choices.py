"""Ranks begin where they are asked to, and loads may go by measured time; no bit depends on it.

Expected duration: 8 s.
"""

from __future__ import annotations

import numpy as np
import pytest

import libmpm
from libmpm import Partition, boundaries, materials, shapes
from libmpm._src.cli.commands import main
from libmpm._src.cli.options import parser as _parser
from libmpm._src.run import backends
from libmpm._src.run.partition import told_ranks
from support import jobs

HEAD = """
import os
import numpy as np
import libmpm
from libmpm import Partition
from python import test_partition_choices as here
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


def told(partition, ranks=2):
    """Return what the engine is told about its ranks."""
    return told_ranks(backends.select(["cpu"] * ranks), partition, flume())["ranks"]


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


@pytest.mark.parametrize(("place", "block"), [(1.5, 1), (1.59, 1), (1.61, 2), (2.0, 3), (5.5, 11)])
def test_planes_are_at_the_nearest_border(place, block):
    """Blocks of 0.4 m begin at 1.0 m; which particles that parts, `test_processes` sees."""
    assert told(Partition(cuts="x", at=[place]))["planes"] == [block]


def test_what_the_engine_is_told():
    assert told(Partition(by=APART))["groups"] == [0, 1, 1]
    assert told(Partition(by="body"), 3)["groups"] == [0, 1, 2]
    assert told(Partition(by="material"))["groups"] == [0, 1, 1]
    assert told(Partition(weights="measured"))["measured"] is True
    assert told(Partition())["measured"] is False


@pytest.mark.parametrize("cuts", [None, "x", "curve"])
def test_groups_of_bodies(one, cuts):
    """The bits of one rank."""
    many = simulate(2, Partition(cuts=cuts, by=APART, rebalance_above=None))
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
        assert same(one, many)


def test_processes(tmp_path):
    """Each process has the particles of its side, or of its group, and the bits of one."""
    code = """
        choices = [Partition(cuts="x", at=[1.7], rebalance_above=None),
                   Partition(by=here.APART, rebalance_above=None),
                   Partition(weights="measured", rebalance_above=0)]
        for k, partition in enumerate(choices):
            sim = libmpm.Simulation(
                here.flume(), device="cpu", ranks="processes", threads=1, partition=partition)
            sim.step(1)
            own = {b: sim.particles[b]["position"][:, 0] - 100.0 for b in sim.particles}
            np.savez(f"{os.environ['FOLDER']}/own {k} {sim.rank}.npz", **own)
            sim.step(59)
            for body in own:
                all_of = sim.gather(body, "position", "stress")
                if sim.rank == 0:
                    np.savez(f"{os.environ['FOLDER']}/all {k} {body}.npz", **all_of)
    """
    jobs.well(jobs.run(2, jobs.script(HEAD, code), tmp_path))
    alone = simulate(1)
    alone.step(60)
    for k in range(3):
        first, second = (np.load(tmp_path / f"own {k} {rank}.npz") for rank in range(2))
        for body in alone.particles:
            if k == 0:
                assert (first[body] < 1.8).all() and (second[body] >= 1.8).all()
            elif k == 1:
                empty = second if body == "water" else first
                assert len(empty[body]) == 0 < len(first[body]) + len(second[body])
            own = alone.gather(body, "position", "stress")
            found = np.load(tmp_path / f"all {k} {body}.npz")
            for name in own:
                assert (found[name] == own[name]).all(), (k, body, name)
    assert len(np.load(tmp_path / "own 0 0.npz")["water"]) > 0


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
        ({"at": (float("inf"),), "cuts": "x"}, r"at\[0\] is inf; expected a finite number in m"),
        ({"at": (1.5,), "cuts": "x", "by": "body"}, "at and by both .*leave the other out"),
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
    resume = ["resume", str(out), "--until", "0.005", "--no-picture", "--quiet"]
    assert main([*resume, "--rebalance-above", "1.5", "--wall-limit", "0"]) == 6
    kept = Partition(cuts="x", at=(2.2,), rebalance_above=1.5)
    assert libmpm.Simulation.resume(out).partition == kept, "what is not named stays"
    assert main([*resume, "--by", "material", "--weights", "measured", "--wall-limit", "0"]) == 6
    changed = Partition(cuts="x", by="material", weights="measured", rebalance_above=1.5)
    assert libmpm.Simulation.resume(out).partition == changed
    assert main(resume) == 0


def test_a_first_place_below_zero():
    """After an equals sign, or it reads as an option."""
    parsed = _parser().parse_args(["run", "s.json", "-o", "x", "--cuts", "x", "--at=-1.2,0.4"])
    assert parsed.at == (-1.2, 0.4)
