"""Debris of laboratory flumes: seeds, contact between pieces, and their near field."""

from __future__ import annotations

import itertools
import warnings
from dataclasses import replace

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, debris, flumes, shapes
from libmpm._src.flumes.debris import add_field
from libmpm._src.flumes.structures import add_contacts


def test_seeds_shift_debris_by_less_than_a_quarter_of_a_cell():
    first, again, other = (
        flumes.WasedaBasin.of_case("5x1-up", seed=s).field() for s in (1, 1, 2)
    )  # fmt: skip
    plain = flumes.WasedaBasin.of_case("5x1-up").field()
    assert first == again != other
    moved = [(p.x - q.x, p.y - q.y) for p, q in zip(first.pieces, plain.pieces, strict=True)]
    assert 0 < np.abs(moved).max() <= 0.25 * 0.02
    assert moved[0] == pytest.approx(moved[3])  # one above the other
    # Without gaps they move as one, and touch as before.
    first, other = (
        flumes.WasedaBasin.of_case("5x1-up", contact=0.3, seed=s).field() for s in (1, 2)
    )
    plain = flumes.WasedaBasin.of_case("5x1-up", contact=0.3).field()
    moved = [(p.x - q.x, p.y - q.y) for p, q in zip(first.pieces, plain.pieces, strict=True)]
    assert np.ptp(moved, axis=0) == pytest.approx(0.0, abs=1e-8) and first != other
    assert 0 < np.abs(moved).max() <= 0.25 * 0.02
    half = flumes.LargeWaveFlume.of_case("8-L-1.0x0.4", seed=3)
    straight = flumes.LargeWaveFlume.of_case("8-L-1.0x0.4")
    assert [p.y for p in half.field().pieces] == [p.y for p in straight.field().pieces]


def test_contact_lets_bars_touch_and_names_their_laws():
    flume = flumes.LargeWaveFlume.of_case("8-L-1.0x0.4", contact=0.3)
    found = {c.name: (c.between, c.law) for c in flume.scene().contacts}
    assert found == {
        "debris": (("debris*", "debris*"), libmpm.contacts.Friction(static=0.3)),
        "afloat": (("debris*", "water"), libmpm.contacts.Fluid()),
    }
    assert flume.field().clearance == 0.0
    apart = replace(flume, contact=None)
    assert apart.field().clearance == 2 * flume.cell_size and not apart.scene().contacts
    gaps = [[d.scene for d in f.deviations() if "gap" in d.what] for f in (flume, apart)]
    assert gaps == [[], ["0.1 m"]]
    # Blocks of the other basin had gaps, which stay.
    blocks = {"width": "full", "cell_size": 0.05, "debris": "hdpe", "contact": 0.3}
    basin = flumes.DirectionalWaveBasin(**blocks, packing=None)
    assert basin.field().clearance == pytest.approx(0.051)
    assert flume.trunk().contact is None


def test_water_beside_contact_is_not_kept_from_packing_but_in_the_strip():
    blocks = {"cell_size": 0.05, "debris": "hdpe", "contact": 0.3}
    for packing in ("density", "shifting"):
        named = f"packing is '{packing}' with contact 0.3.*expected None"
        with pytest.raises(libmpm.SceneError, match=named):
            flumes.DirectionalWaveBasin(**blocks, width="full", packing=packing)
        basin = flumes.DirectionalWaveBasin(**blocks, width="half", packing=packing)
        with pytest.raises(libmpm.SceneError, match=named + r"; or run its near_field\(\)"):
            basin.scene()
        assert "near_field" in str(basin)
        assert basin.trunk().scene().bodies[0].fbar == libmpm.FBar(**{packing: True})


@pytest.mark.parametrize(
    ("name", "case"), [(n, c) for n in flumes.names() for c in flumes.named(n).cases]
)
def test_every_case_can_be_run(name, case):
    kind = flumes.named(name)
    coarse = min(2.5 * kind.of_case(case).cell_size, 0.05 if name == "wasirf" else 0.2)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", libmpm.ModelWarning)
        scene = kind.of_case(case, cell_size=coarse).scene()
        assert libmpm.Simulation(scene, device="cpu").plan.memory_total > 0


@pytest.mark.parametrize(("contact", "opened"), [(0.3, 0.04), (None, 0.0)])
def test_pieces_that_touch_part_with_contact_alone(contact, opened):
    flume = flumes.WasedaBasin(
        width="full", cell_size=0.02, debris="3x1-upstream", gap=0.0, contact=contact
    )
    scene = libmpm.Scene(dimension=3, cell_size=0.02, lower=(4.5, -0.4, 0.1), upper=(4.9, 0.4, 0.5))
    names = add_field(scene, flume.field(), elevation=0.26, displaces=())
    for name, speed in zip(names, (-0.2, 0.0, 0.2), strict=True):
        scene.replace(name, velocity=(0.0, speed, 0.0))
    add_contacts(scene, flume.contact)
    sim = libmpm.Simulation(scene, device="cpu", threads=1)

    def gaps():
        y = [np.asarray(sim.particles[name]["position"])[:, 1] for name in names]
        return np.array([b.min() - a.max() for a, b in itertools.pairwise(y)])

    before = gaps()
    sim.run(until=0.2, progress=False)
    assert gaps() - before == pytest.approx(opened, abs=0.001)


@pytest.mark.parametrize(
    ("flume", "names"),
    [(flumes.DirectionalWaveBasin(cell_size=0.1, width="half", channel=2.0, debris="mixed"),
      {"platform-friction-1", "platform-friction-2"}),
     (flumes.WasedaBasin(cell_size=0.05, width="full", debris="3x1-upstream"), {"apron-friction"})],
)  # fmt: skip
def test_water_may_be_below_debris_on_a_bed(flume, names):
    """A kind of debris has one boundary, with its friction and the water in its gap."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", libmpm.ModelWarning)
        for uplift in (True, False):
            scene = replace(flume, uplift=uplift).scene()
            scene.validate()
            found = {b.name: b.uplift for b in scene.boundaries if "friction" in b.name}
            assert found == dict.fromkeys(names, uplift)
    with pytest.raises(libmpm.SceneError, match="uplift is 'yes'; expected True or False"):
        replace(flume, uplift="yes")


def test_box_and_bars_stand_in_the_cut_run_of_a_strip(tmp_path, monkeypatch):
    flume = flumes.LargeWaveFlume(
        width="half", cell_size=0.2, structure="box", debris="1-T-0.1x0.5", gap=0.4, end=60.0
    )
    given = {"begin": 15.2, "lower": 30.0, "until": 15.4, "device": "cpu"}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", libmpm.ModelWarning)
        made = flume.near_field(tmp_path, **given)
        log = (tmp_path / "trunk" / "log.json").stat().st_mtime_ns
        again = flume.near_field(tmp_path, **given)
        assert again == made and (tmp_path / "trunk" / "log.json").stat().st_mtime_ns == log
        assert made.lower[0] == pytest.approx(30.0) and made.upper[0] == pytest.approx(60.0)
        assert made.upper[1] == pytest.approx(1.8)
        # The strip keeps velocities as the flume with its box would, which it continues as.
        assert made.transfer == flume.scene().transfer and made.transfer.flip == 0.99
        assert {"bed", "walls", "near-piston", "box"} == {b.name for b in made.boundaries}
        assert {"WG2", "WG3", "USWG2", "ADV", "box"} <= {s.name for s in made.sensors}
        sim = libmpm.Simulation(made, device="cpu", threads=1)
        sim.step(3)
        whole = libmpm.Simulation(flume.scene(), device="cpu", threads=1)
    # At rest, and the water of half of the flume from the cut on.
    beyond = np.asarray(whole.particles["water"]["position"])[:, 0] >= 30.0
    assert len(sim.particles["water"]) == pytest.approx(np.count_nonzero(beyond), rel=0.003)
    assert [b.name for b in made.bodies] == ["water", "debris-1"]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", libmpm.ModelWarning)
        # The same water, with bars that touch and have velocities of their own.
        touching = replace(flume, debris="8-L-1.0x0.4", gap=None, contact=0.3)
        loose = touching.near_field(tmp_path, **given)
        assert [c.name for c in loose.contacts] == ["debris", "afloat"]
        assert loose.start == made.start
        sim = libmpm.Simulation(loose, device="cpu", threads=1)
        sim.step(3)
        assert sim.engine.statistics()["contact_blocks"] > 0
    with pytest.raises(libmpm.SceneError, match="lower is 40 m; expected between the stations"):
        flume.near_field(tmp_path, lower=40.0)
    with pytest.raises(libmpm.SceneError, match=r"is a cut at 15\.2\d* s .* give another folder"):
        flume.near_field(tmp_path, **(given | {"begin": 15.3}))
    low = flume.box().lower[2]
    with warnings.catch_warnings(), monkeypatch.context() as patch:
        warnings.simplefilter("ignore", libmpm.ModelWarning)
        under = type(flume.box())(lower=(41.4, 0.0, low - 0.4), upper=(42.4, 0.6, low + 0.2))
        patch.setattr(flumes.LargeWaveFlume, "box", lambda self: under)
        with pytest.raises(
            libmpm.SceneError, match=r"when \d+ particles of water .* begin earlier"
        ):
            flume.near_field(tmp_path, **given)
    with pytest.raises(libmpm.SceneError, match="holds another run"):
        replace(flume, cell_size=0.25).near_field(tmp_path, **given)


def test_blocks_stand_in_the_cut_run_of_a_channels_strip(tmp_path):
    flume = flumes.DirectionalWaveBasin(
        width="half", cell_size=0.15, channel=2.0, debris="hdpe", friction=0.3
    )
    given = {"begin": 11.5, "lower": 22.0, "until": 11.8, "device": "cpu"}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", libmpm.ModelWarning)
        made, whole = flume.near_field(tmp_path, **given), flume.scene()
        sim = libmpm.Simulation(made, device="cpu", threads=1)
        sim.step(3)
        water = libmpm.Simulation(whole, device="cpu", threads=1).particles["water"]
        # Other layouts have the same water.
        bare = replace(flume, debris=None, structure="boxes").near_field(tmp_path, **given)
        # With contact too, beside which nothing leads its volumes on.
        touching = replace(flume, contact=0.3).near_field(tmp_path, **given)
        assert touching.start == made.start and made.bodies[0].fbar == libmpm.FBar(density=True)
        assert touching.bodies[0].fbar == libmpm.FBar()
        touching.save(tmp_path / "scene.json")
        assert libmpm.Scene.load(tmp_path / "scene.json") == touching
        libmpm.Simulation(touching, device="cpu", threads=1).step(3)
    cut = made.lower[0]
    assert cut == pytest.approx(22.05) and made.upper == pytest.approx(whole.upper)
    # At rest, and the water of half of the channel from the cut on.
    beyond = np.count_nonzero(np.asarray(water["position"])[:, 0] >= cut)
    assert len(sim.particles["water"]) == pytest.approx(beyond, rel=0.003)
    known = {b.name: b for b in whole.boundaries}
    own = {b.name: b for b in made.boundaries}
    assert set(own) == {"bed", "walls", "near-piston", "platform-friction"}
    assert own["bed"].response == known["bed"].response == boundaries.Separable(cell="held")
    assert made.transfer == whole.transfer and made.transfer.scheme == "APIC"
    # Blocks and their friction are those of the channel, and instruments those beyond the cut.
    names = [b.name for b in whole.bodies]
    assert [b.name for b in made.bodies] == names and len(names) == 1 + 12
    for one, other in zip(made.bodies[1:], whole.bodies[1:], strict=True):
        assert one.shape == other.shape and one.material == other.material
    rubs = own["platform-friction"]
    assert rubs.bodies == known["platform-friction"].bodies == tuple(names[1:])
    assert rubs.response.dynamic_friction == 0.3
    x = {i.name: i.x for i in flume.instruments()}
    there = [s.name for s in whole.sensors if x.get(s.name, cut) >= cut]
    stations = [s.name for s in made.sensors if s.name.startswith(("flow-", "mass-"))]
    assert [s.name for s in made.sensors] == stations + there
    assert {"USWG5", "front-1", "platform", "USWG-h5", "debris-12"} <= set(there)
    # What it has of the strip it keeps, also past obstacles.
    assert bare.start == made.start and bare.transfer == made.transfer
    assert bare.boundaries[0].response == own["bed"].response
    assert {"box-2"} == {b.name for b in bare.boundaries} - set(own)
    strip = flume.trunk().scene()
    assert strip.upper[1] == pytest.approx(0.15) and [b.name for b in strip.bodies] == ["water"]
    assert {s.name.split("-")[0] for s in strip.sensors} == {"flow", "mass"}
    with pytest.raises(libmpm.SceneError, match=r"lower is 17 m; expected .* 18 to 28 m"):
        flume.near_field(tmp_path, **(given | {"lower": 17.0}))
    with pytest.raises(libmpm.SceneError, match=r"begin is 11\.2 s .* between 11\.3 and 11\.8 s"):
        flume.near_field(tmp_path, **(given | {"begin": 11.2}))
    with pytest.raises(libmpm.SceneError, match="width is 'full'; expected 'half'"):
        replace(flume, width="full").near_field(tmp_path, **given)


@pytest.mark.parametrize("contact", [True, False])
@pytest.mark.parametrize("surface", [True, False])
@pytest.mark.parametrize(
    ("cell", "measured"), [("held", (0.39, 0.41)), ("auto", (0.40, 0.53)), ("linear", (0.40, 0.53))]
)
@pytest.mark.parametrize("first", [True, False])
def test_friction_of_a_bed_is_felt_beside_the_bed(contact, surface, cell, measured, first):
    """A block slows down by μ g, whichever of the two boundaries is defined first.

    Where water shares its velocities a bed of linear cells has its pressing along lines, of which
    held nodes, which rub, take more than their part.
    """
    low, high = (0.2, 0.08, 0.0), (0.26, 0.22, 0.06)
    scene = libmpm.Scene(
        dimension=3, cell_size=0.02, lower=(0.0, 0.0, -0.1), upper=(1.2, 0.3, 0.4),
        gravity=(0.0, 0.0, -9.81),
    )  # fmt: skip
    soft = libmpm.materials.FixedCorotated(density=419.0, youngs_modulus=39e3, poissons_ratio=0.4)
    scene.add_body(
        name="debris-1", shape=shapes.Box(lower=low, upper=high), material=soft,
        velocity=(1.0, 0.0, 0.0),
    )  # fmt: skip
    scene.add_body(
        name="water", shape=shapes.Box(lower=(1.0, 0.0, 0.0), upper=(1.2, 0.3, 0.02)),
        material=libmpm.materials.TaitFluid(bulk_modulus=2e5),
    )  # fmt: skip
    sides = shapes.DomainWalls(faces=("x-", "x+", "y-", "y+"))
    scene.add_boundary(name="sides", shape=sides, response=boundaries.Separable())
    ground = ((-1.0, 0.0), (2.0, 0.0), (2.0, -1.0), (-1.0, -1.0))
    bed = shapes.Box(lower=(-1.0, -1.0, -1.0), upper=(2.0, 1.0, 0.0))
    if surface:
        bed = shapes.Extrusion(profile=ground, axis="y", lower=-1.0, upper=1.0)
    if first:
        flumes.add_bed_friction(scene, bed, {"debris-1": 0.4})
    scene.add_boundary(name="bed", shape=bed, response=boundaries.Separable(cell=cell))
    if not first:
        flumes.add_bed_friction(scene, bed, {"debris-1": 0.4})
    if contact:
        scene.add_contact(name="afloat", between=("debris-1", "water"), law=libmpm.contacts.Fluid())
    sim = libmpm.Simulation(scene, device="cpu", precision="single", threads=1)
    speed = []
    for until in (0.05, 0.15):
        sim.run(until=until, progress=False)
        speed.append(float(sim.particles["debris-1"]["velocity"][:, 0].mean()))
    low, high = (0.39, 0.41) if contact and cell == "auto" else measured
    assert low < (speed[0] - speed[1]) / 0.1 / 9.81 < high


@pytest.mark.parametrize(
    ("response", "rises"), [(boundaries.Slip(), False), (boundaries.Separable(), True)]
)
def test_water_lifts_a_piece_off_a_bed_that_lets_go(response, rises):
    """Off `Slip` nothing comes, and validate says so of what is lighter than a fluid."""
    scene = libmpm.Scene(
        dimension=2, cell_size=0.015, lower=(0.0, 0.0), upper=(1.5, 0.6), gravity=(0.0, -9.81)
    )
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0.0, 0.0), upper=(0.45, 0.3)),
        material=libmpm.materials.TaitFluid(bulk_modulus=2e5),
    )  # fmt: skip
    scene.add_body(
        name="debris-1", shape=shapes.Box(lower=(0.75, 0.0), upper=(0.9, 0.06)),
        material=libmpm.materials.FixedCorotated(
            density=419.0, youngs_modulus=39e3, poissons_ratio=0.4
        ),
    )  # fmt: skip
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=response)
    scene.add_contact(name="afloat", between=("debris-1", "water"), law=libmpm.contacts.Fluid())
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        scene.validate()
    held = [str(w.message) for w in said if "lies on boundary 'walls'" in str(w.message)]
    assert bool(held) != rises and ("boundaries.Separable" in "".join(held)) != rises
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", libmpm.ModelWarning)
        sim = libmpm.Simulation(scene, device="cpu", precision="single", threads=1)
        sim.run(until=4.0, progress=False)
    height = float(sim.particles["debris-1"]["position"][:, 1].mean())
    # Depth 0.09 m less a draught of 0.419 of its own 0.06 m, which sloshes yet.
    assert (height > 0.06) if rises else (height == pytest.approx(0.03, abs=0.003))


def field_of(*places: tuple[float, float, float]) -> debris.DebrisField:
    """Bars at (x, y) m, turned by so many degrees, before the box of the Large Wave Flume."""
    bar = debris.Prototype(
        length=0.5, width=0.1, height=0.05, name="bar",
        material=libmpm.materials.FixedCorotated(
            density=981, youngs_modulus=1e6, poissons_ratio=0.4
        ),
    )  # fmt: skip
    return debris.DebrisField(
        prototypes=(bar,), corner=(37.0, -1.6), footprint=(3.0, 3.2),
        pieces=[debris.Piece(x=x, y=y, angle=angle) for x, y, angle in places],
    )  # fmt: skip


def test_half_of_a_flume_has_the_half_of_a_field():
    def solids(width: str, *places: tuple[float, float, float]) -> list[tuple[float, ...]]:
        made = flumes.LargeWaveFlume(
            width=width, cell_size=0.1, structure="box", end=50.0, debris=field_of(*places)
        ).scene()
        shapes_of = [b.shape for b in made.bodies if b.name.startswith("debris-")]
        leans = [getattr(s, "angle", 0.0) % 90.0 for s in shapes_of]
        return sorted((*np.round(np.ravel(s.bounds()), 9), angle)
                      for s, angle in zip(shapes_of, leans, strict=True))  # fmt: skip

    upper = (38.0, 0.6, 30.0), (38.8, 0.9, 90.0)
    lower = (38.0, -0.6, 150.0), (38.8, -0.9, -90.0)
    half = solids("half", *upper)
    assert len(half) == 2
    assert solids("half", *upper, *lower) == half  # those at y < 0 are its image
    whole = solids("full", *upper, *lower)
    assert [one for one in whole if one[1] > 0] == half
    # Cut along the centreline.
    assert solids("half", (38.0, 0.0, 90.0)) == [(37.95, 0.0, *half[0][2:3], 38.05, 0.25,
                                                  half[0][5], 0.0)]  # fmt: skip


@pytest.mark.parametrize("kind", [flumes.LargeWaveFlume, flumes.WASIRF])
@pytest.mark.parametrize(
    ("places", "message"),
    [
        ([(38.0, -0.6, 30.0)], r"at \(38, -0\.6\) m without its image at \(38, 0\.6\) m"),
        ([(38.0, -0.6, 30.0), (38.0, 0.6, 30.0)], r"at \(38, -0\.6\) m without its image"),
        ([(38.0, -0.6, 0.0), (38.0, 0.6, 0.0), (38.8, 0.6, 0.0)], r"at \(38\.8, 0\.6\) m without"),
        ([(38.0, 0.0, 30.0)], r"across the centreline, turned by 30 degrees"),
        ([(38.0, 0.1, 90.0)], r"across the centreline and not in its middle"),
    ],
)
def test_half_of_a_flume_loses_and_adds_no_piece_in_silence(kind, places, message):
    with pytest.raises(libmpm.SceneError, match=message + ".* use width='full'"):
        kind(width="half", debris=field_of(*places))
