"""A guard warns of water that has got lower than its volume can lie, and of no other."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, materials, shapes
from libmpm._src.run.guard_water_level import basin_of
from support.devices import device  # noqa: F401

DX = 0.05


def domain(upper=(0.4, 0.4), gravity=(0.0, -9.81), response=None, **more):
    scene = libmpm.Scene(
        dimension=len(upper), lower=(0.0,) * len(upper), upper=upper, cell_size=DX,
        gravity=gravity, **more,
    )  # fmt: skip
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=response or slip())
    return scene


def slip():
    return boundaries.Slip()


def water(modulus=2e4):
    return materials.TaitFluid(density=1000.0, bulk_modulus=modulus)


def resting(fbar, response=None, cells=4, wide=4, modulus=2e4, **more):
    """Return a tank at rest, its middle at half its depth; ρgH/K is a tenth unless told."""
    depth = cells * DX
    scene = domain((wide * DX, depth + 2 * DX), response=response, **more)
    scene.add_body(
        name="tank", shape=shapes.Box(lower=(0, 0), upper=(wide * DX, depth)), fbar=fbar,
        hydrostatic=depth, material=water(modulus),
    )  # fmt: skip
    return scene


def start(scene, guard=None, **how):
    return libmpm.Simulation(scene, **({"device": "cpu", "threads": 1} | how), guard=guard)


# What is named -----------------------------------------------------------------------------------

#: The average without its gradient is one-sided at bed and surface (design/fbar.md, 2), and water
#: sinks under it while its volumes stay what they were; the sooner the faster it is taken.
PLAIN = libmpm.FBar(form="one-volume", time=0.03)


def test_water_that_sinks_is_named_once(device):  # noqa: F811
    simulation = start(resting(PLAIN), libmpm.Guard(every=100), device=device)
    with pytest.warns(libmpm.ModelWarning, match="has sunk") as caught:
        while not caught and simulation.steps < 2000:
            simulation.step(100)
        middle = simulation.particles["tank"]["position"][:, 1].mean() / (4 * DX)
        ratio = simulation.particles["tank"]["volume_ratio"].mean()
        simulation.step(500)
    (text,) = [str(w.message) for w in caught if "has sunk" in str(w.message)]
    for part in ("'tank'", "m² of its", "expected at least", "fbar=None", "Guard(level=None)"):
        assert part in text, text
    # A twentieth of the height and a tenth of a cell: a tenth of this one. It was filled to where
    # unloaded water stands, half of ρgH/K above where its volumes would.
    assert 0.9 * ratio - 0.02 < 2 * middle < 0.9 * ratio + 0.001
    assert ratio == pytest.approx(0.965, abs=0.01), "its volumes hardly know"


def test_the_warning_and_what_it_knows_survive_a_checkpoint(tmp_path):
    simulation = start(resting(PLAIN), libmpm.Guard(every=100))
    with pytest.warns(libmpm.ModelWarning, match="has sunk"):
        simulation.step(2050)
    simulation.save_checkpoint(tmp_path / "sunk.npz")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        libmpm.Simulation.resume(tmp_path / "sunk.npz").step(200)


def test_none_leaves_it_unwatched():
    simulation = start(resting(PLAIN), libmpm.Guard(every=100, level=None))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        simulation.step(2000)


def test_a_state_with_layers_in_one_another_is_named(monkeypatch):
    # What a look would see of it: the middle of twelve cells lower by parts, volumes as they were.
    from libmpm._src.run.guard_watch import Watch

    simulation = start(resting("default", cells=12, modulus=2e6), libmpm.Guard(every=10))
    simulation.step(15)
    seen = Watch._condition

    def lower(part):
        def condition(self):
            now = seen(self)
            return now | {"potential": part * now["potential"]}

        return condition

    # Allowed are a twentieth of six cells and a tenth of one.
    monkeypatch.setattr(Watch, "_condition", lower(0.94))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        simulation.step(10)
    monkeypatch.setattr(Watch, "_condition", lower(0.92))
    with pytest.warns(libmpm.ModelWarning, match="has sunk"):
        simulation.step(10)


# What is not -------------------------------------------------------------------------------------


def splash(shelf=False, upright=(0.0, -9.81), upper=(1.0, 1.0), **more):
    scene = domain(upper, upright, **more)
    if shelf:
        box = shapes.Box(lower=(0.5, 0), upper=(1, 0.2))
        scene.add_boundary(name="shelf", shape=box, response=slip())
    low, high = ((0, 0), (0.4, 0.6)) if upright[1] < 0 else ((0, 0.4), (0.4, 1.0))
    scene.add_body(
        name="water", shape=shapes.Box(lower=low, upper=high), material=water(4e5),
    )  # fmt: skip
    return scene


@pytest.mark.parametrize(
    "scene",
    [
        resting("default"),
        resting("default", response=boundaries.Mirror()),
        resting(None),
        splash(),
        splash(shelf=True),
        splash(upright=(0.0, 9.81)),
        splash(upright=(3.0, -9.0)),
        splash(method=libmpm.Method(transfer="FLIP")),
        splash(upper=(3.0, 1.0), response=boundaries.Mirror()),
    ],
    ids=["rest", "mirrored", "no F-bar", "dam", "shelf", "up", "tilted", "FLIP", "film"],
)
def test_honest_scenes_are_left_alone(scene, device):  # noqa: F811
    simulation = start(scene, libmpm.Guard(every=50), device=device)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        simulation.step(1500)


def spilling(faces, flow=None, **more):
    """Return a domain that is walled on some faces, with a slab of water over half of its floor."""
    scene = libmpm.Scene(
        dimension=2, lower=(0.0, 0.0), upper=(1.0, 0.8), cell_size=DX, gravity=(0.0, -9.81), **more
    )
    walls = shapes.DomainWalls(faces=faces)
    scene.add_boundary(name="walls", shape=walls, response=slip())
    if flow is not None:
        scene.add_flow(name="out", flow=flow)
    body = shapes.Box(lower=(0, 0), upper=(0.6, 0.4))
    scene.add_body(name="water", shape=body, material=water(4e5))
    return scene


def test_open_scenes_are_judged_too(monkeypatch):
    """What goes out by a side takes its volume along: the middle stays above what is left."""
    from libmpm._src.run.guard_watch import Watch

    lows = []
    seen = Watch._lies
    monkeypatch.setattr(Watch, "_lies", lambda self, now: lows.append(seen(self, now)) or lows[-1])
    scene = spilling(("y-", "x-"), boundaries.Outflow(face="x+"))
    sim = start(scene, libmpm.Guard(every=200))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sim.run(until=1.0, progress=False)
    assert sim.outflow["out"].values[-1, 0] > 50
    assert lows[0][1:] == pytest.approx((0.2, 0.12, 0.0), abs=2e-3)
    left = len(sim.particles["water"]) * (0.5 * DX) ** 2
    assert lows[-1][2] == pytest.approx(0.5 * left, rel=0.05)


@pytest.mark.parametrize(
    ("flow", "more"),
    [
        (boundaries.Outflow(face="y-"), {}),
        (None, {"method": libmpm.Method(leaving="delete")}),
    ],
)
def test_nothing_is_low_where_there_is_no_floor(flow, more):
    """Half a particle hangs out of the domain before its place does."""
    scene = spilling(("x-", "x+"), flow, **more)
    assert basin_of(scene) is None
    with warnings.catch_warnings():
        warnings.filterwarnings("error", message=".*has sunk")
        start(scene, libmpm.Guard(every=50)).run(until=0.5, progress=False)


# The least height --------------------------------------------------------------------------------


def test_a_basin_is_filled_from_its_lowest_place():
    scene = domain((2.0, 1.0))
    box = shapes.Box(lower=(0.5, 0.0), upper=(2.0, 0.4))
    scene.add_boundary(name="shelf", shape=box, response=slip())
    basin = basin_of(scene)
    assert basin.areas == pytest.approx([0.5, 2.0])
    assert basin.lowest_middle(0.1) == pytest.approx((0.1, 0.0))
    # 0.2 m² in the pit at 0.2 m, 0.4 m² above it at 0.5 m.
    assert basin.lowest_middle(0.6) == pytest.approx((0.4, 0.0))
    assert basin.lowest_middle(0.0) is None and basin.lowest_middle(1.5) is None


def test_boxes_are_where_the_engine_puts_them():
    """A face in the middle of a cell goes up; g cos 90° is no second direction."""
    for low, face in ((0.125, 0.15), (0.225, 0.25)):
        scene = domain((1.0, 1.0), gravity=(6e-16, -9.81))
        box = shapes.Box(lower=(low, 0.0), upper=(1.0, 0.9))
        scene.add_boundary(name="shelf", shape=box, response=slip())
        assert basin_of(scene).areas[0] == pytest.approx(face)


def test_many_boxes_are_quickly_told():
    random = np.random.default_rng(0)
    scene = domain((10.0, 10.0, 4.0), gravity=(0.0, 0.0, -9.81))
    taken = np.zeros((200, 200, 80), dtype=bool)
    for k in range(150):
        low = random.integers(0, (190, 190, 70))
        high = low + random.integers(1, 10, 3)
        taken[tuple(slice(a, b) for a, b in zip(low, high, strict=True))] = True
        box = shapes.Box(lower=low * DX, upper=high * DX)
        scene.add_boundary(name=f"box-{k}", shape=box, response=slip())
    basin = basin_of(scene)
    free = np.diff(basin.bounds) @ basin.areas
    assert free == pytest.approx((~taken).sum() * DX**3)


@pytest.mark.parametrize("seed", range(5))
def test_no_cells_lie_lower_than_the_lowest(seed):
    """Cells of any free places, any gravity along an axis: never below; sorted by height: there."""
    random = np.random.default_rng(seed)
    count = (6, 5, 4)
    axis, sign = int(random.integers(3)), int(random.choice([-1, 1]))
    gravity = [0.0, 0.0, 0.0]
    gravity[axis] = 9.81 * sign
    scene = domain(tuple(n * DX for n in count), tuple(gravity))
    free = np.ones(count, dtype=bool)
    for k in range(3):
        low = [int(random.integers(0, n - 1)) for n in count]
        high = [int(random.integers(a + 1, n)) for a, n in zip(low, count, strict=True)]
        box = shapes.Box(lower=[a * DX for a in low], upper=[b * DX for b in high])
        scene.add_boundary(name=f"box-{k}", shape=box, response=slip())
        free[tuple(slice(a, b) for a, b in zip(low, high, strict=True))] = False
    basin = basin_of(scene)
    height = -sign * (np.argwhere(free)[:, axis] + 0.5) * DX
    assert (basin.areas * np.diff(basin.bounds)).sum() == pytest.approx(free.sum() * DX**3)
    cells = int(random.integers(1, len(height)))
    low = basin.lowest_middle(cells * DX**3)[0]
    assert random.permutation(height)[:cells].mean() >= low - 1e-12
    layers = np.sort(height)
    whole = np.flatnonzero(np.diff(layers) > 1e-9)[0] + 1  # the lowest layer is filled evenly
    assert basin.lowest_middle(whole * DX**3)[0] == pytest.approx(layers[:whole].mean())


def test_what_moves_or_is_no_box_counts_as_free():
    scene = domain((1.0, 1.0))
    pit = shapes.Box(lower=(0.5, 0), upper=(1, 0.4))
    push = libmpm.TimeTable(time=(0.0, 0.1), value=((0.1, 0.0), (0.1, 0.0)))
    scene.add_boundary(name="gone", shape=pit, response=slip(), time=(0.0, 1.0))
    scene.add_boundary(name="paddle", shape=pit, response=slip(), motion=push)
    scene.add_boundary(name="ball", shape=shapes.Sphere(centre=(0.5, 0.5), radius=0.2),
                       response=slip())  # fmt: skip
    assert basin_of(scene).areas == pytest.approx([1.0])
    assert basin_of(domain(gravity=(1.0, -9.81))) is None
    assert basin_of(domain(gravity=(0.0, 0.0))) is None
    assert math.isclose(libmpm.Guard(level=0.2).level, 0.2)
    with pytest.raises(libmpm.SceneError, match="level"):
        libmpm.Guard(level=-1.0)
