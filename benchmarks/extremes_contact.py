"""Axes of bodies that touch: one number of a small plane scene with contact at its extremes.

Each scene has a closed form or a balance that must hold: momentum of both to rounding, the impulses
of `sensors.ContactLoad` that of each body, no energy gained, no overlap beyond half a cell, bodies
that come apart, Coulomb's friction, the force of a bar that is squeezed, the mass of the water that
goes along with a block.
"""

from __future__ import annotations

import math

import numpy as np
from extremes_axis import Axis, Trial, bounded, energies, first, no_energy_gain
from extremes_solids import (
    DENSITY,
    DX,
    EDGE,
    GRAVITY,
    YOUNG,
    axis,
    cells,
    domain,
    solid,
    under_water,
    wave_speed,
)  # fmt: skip
from numpy.typing import NDArray

import libmpm
from libmpm import boundaries, contacts, materials, sensors, shapes

Numbers = NDArray[np.float64]

#: Overlap that no two bodies may have, cells.
OVERLAP = 0.5


def mean(simulation: libmpm.Simulation, body: str, attribute: str) -> Numbers:
    """Return the mean of an attribute over a body's particles, which weigh the same."""
    found: Numbers = np.asarray(simulation.particles[body][attribute], dtype=np.float64)
    return np.asarray(found.mean(axis=0))


def rounding(simulation: libmpm.Simulation) -> float:
    """Return what part of a momentum may round away: half a digit each step, all one way."""
    if simulation.precision == "single":
        return 1e-5 + 5e-8 * simulation.steps
    return 1e-12 + 1e-16 * simulation.steps


def overlap(simulation: libmpm.Simulation, low: str, high: str, along: int, width: float) -> float:
    """Return how far the faces of two bodies overlap along an axis, cells; below 0 apart.

    By the middle `width` of each face, m, around which a soft one may bulge; a particle reaches a
    quarter of a cell as it is stretched.
    """
    reach = 0.0
    for body, side in ((low, 1.0), (high, -1.0)):
        read = simulation.particles[body].read(["position", "deformation_gradient"])
        place = np.asarray(read["position"], dtype=np.float64)
        across = place[:, 1 - along]
        inside = np.abs(across - across.mean()) < width / 2
        half = 0.25 * DX * np.asarray(read["deformation_gradient"])[inside, along, along]
        reach += float((side * place[inside, along] + half).max())
    return reach / DX


def after(simulation: libmpm.Simulation, sensor: str, start: float) -> tuple[Numbers, Numbers]:
    """Return the lengths of the steps that changed velocities since a time, and their impulse.

    Velocities that are read have been through the update that a sample of the next step tells of;
    those of the start have not. Takes a step.
    """
    simulation.step(1)
    series = simulation.sensors[sensor]
    begin = 0 if start < 0 else int(np.searchsorted(series.time, start, side="right")) + 1
    length = np.diff(series.time, prepend=0.0)[begin:]
    force = np.stack([series[f"force_{a}"][begin:] for a in "xy"])
    return length, force @ length


# ---- collisions ---------------------------------------------------------------------------------


def collision(stiffness: float = 1.0, density: float = 1.0, mach: float = 0.1) -> Trial:
    """A block flies at one `stiffness` times as stiff and `density` times as dense; 4 x 4 cells.

    At `mach` of the slower wave, which then passes the slower one six times. What the first loses
    the second gets, and the sensor of the contact adds up; they come apart, along the line on which
    they met; nothing overlaps; energy does not grow by 1 % of what such a blow can take, which is
    that of the reduced mass. A light one beside a heavy one is not lost in what that rounds.
    """
    size, gap = 4, min(1.0, 20 * mach)
    wide = 32 + 2 * math.ceil(6 * size * mach)
    slow = min(wave_speed(), wave_speed(YOUNG * stiffness, density=DENSITY * density))
    speed = mach * slow
    scene = domain("collision", (wide, 14))
    scene.add_body(
        name="first", shape=cells(6, 5, size=(size, size)), material=solid(), velocity=(speed, 0.0)
    )
    scene.add_body(
        name="second", shape=cells(6 + size + gap, 5, size=(size, size)),
        material=solid(young=YOUNG * stiffness, density=DENSITY * density),
    )  # fmt: skip
    scene.add_contact(name="blow", between=("first", "second"), law=contacts.Friction(static=0.3))
    until = gap * DX / speed + 6 * size * DX / slow
    scene.add_sensor(name="energy", sensor=sensors.Energy(interval=until / 200))
    load = sensors.ContactLoad(contact="blow", interval=until / 400)
    scene.add_sensor(name="blow", sensor=load)
    mass = DENSITY * (size * DX) ** 2
    reduced = mass * density / (1 + density)

    def watch(simulation: libmpm.Simulation) -> str:
        found = overlap(simulation, "first", "second", 0, size * DX / 2)
        return bounded("overlap, cells", found, -math.inf, OVERLAP)

    def judge(simulation: libmpm.Simulation) -> str:
        one, two = (mean(simulation, body, "velocity") for body in ("first", "second"))
        given = mass * density * two
        lost = mass * (np.array([speed, 0.0]) - one)
        told = np.array([simulation.sensors["blow"].impulse(f"force_{a}") for a in "xy"])
        scale, drift = reduced * speed, rounding(simulation)

        def beside(what: Numbers) -> float:
            return float(np.abs(what - given).max()) / scale

        return (
            bounded("impulse told, beside the momentum given", beside(told), 0.0, drift)
            or bounded("momentum lost in all", beside(lost), 0.0, drift * max(1.0, 1 / density))
            or bounded("speed apart, of the approach", float(two[0] - one[0]) / speed, 0.0, 1.01)
            or bounded("momentum across", float(abs(given[1])) / scale, 0.0, 0.05)
        )

    def gain(simulation: libmpm.Simulation) -> str:
        total = energies(simulation)["total"]
        least = 2e-9 * simulation.steps * float(total[0])  # what single precision rounds
        least = least if simulation.precision == "single" else 0.0
        found = (float(np.max(total - total[0])) - least) / (0.5 * reduced * speed**2)
        return bounded("gain of energy, of what the blow can take", found, -math.inf, 0.01)

    return Trial(scene=scene, until=until, watch=watch, judge=first(judge, gain), pieces=64)


# ---- squeezed -----------------------------------------------------------------------------------


def squeezed(
    part: float, ratio: float = 100.0, *, static: float = 0.0, fine: int = 1, cfl: float = 0.4
) -> Trial:
    """A soft block of 12 x 8 cells is squeezed by `part` of its height, between stiffer ones.

    With friction of `static` where asked for, and of `fine` times as many cells along each edge.

    These are `ratio` times as stiff and held but for two cells; they come together in ten passages
    of a wave through the soft one and stay for ten. Without Poisson's ratio a fixed corotated block
    has the force E strain on its width. Of that the force, over the last five, is 0.85 to 1.05,
    since the outermost cell of an edge does not carry yet; both sides feel the same.
    """
    wide, high, free = 12 * fine, 8 * fine, 2
    travel = part * high / 2
    thick = math.ceil(travel) + 2 * free
    passage = high * DX / math.sqrt(YOUNG / DENSITY)
    speed = travel * DX / (10 * passage)
    size = wide + 12, high + 2 * thick + 4
    low, left = 2 + thick, 6

    def material(young: float) -> materials.FixedCorotated:
        return materials.FixedCorotated(density=DENSITY, youngs_modulus=young, poissons_ratio=0.0)

    scene = domain("squeezed", size, cfl=cfl)
    scene.add_body(name="soft", shape=cells(left, low, size=(wide, high)), material=material(YOUNG))
    motion = {
        side: libmpm.TimeTable(
            time=[0.0, 10 * passage, 10.001 * passage, 100 * passage],
            value=[[0.0, side * speed]] * 2 + [[0.0, 0.0]] * 2,
        )
        for side in (1.0, -1.0)
    }
    interval = passage / 10
    scene.add_sensor(name="energy", sensor=sensors.Energy(interval=interval))
    for name, at, side, outer in (
        ("below", low - thick, 1.0, (0, low - free)),
        ("above", low + high, -1.0, (low + high + free, size[1])),
    ):
        scene.add_body(
            name=name, shape=cells(left - 2, at, size=(wide + 4, thick)),
            material=material(YOUNG * ratio),
        )  # fmt: skip
        scene.add_boundary(
            name=f"press {name}", response=boundaries.Prescribed(), bodies=(name,),
            shape=cells(0, outer[0], size=(size[0], outer[1] - outer[0])), motion=motion[side],
        )  # fmt: skip
    law = contacts.Friction(static=static)
    scene.add_contact(name="faces", between=("*", "soft"), law=law)
    for name in ("below", "above"):
        load = sensors.ContactLoad(contact="faces", pair=(name, "soft"), interval=interval)
        scene.add_sensor(name=name, sensor=load)

    def watch(simulation: libmpm.Simulation) -> str:
        width = wide * DX / 2
        found = max(
            overlap(simulation, "below", "soft", 1, width),
            overlap(simulation, "soft", "above", 1, width),
        )
        return bounded("overlap, cells", found, -math.inf, OVERLAP)

    def judge(simulation: libmpm.Simulation) -> str:
        force = (simulation.sensors[name]["force_y"] for name in ("below", "above"))
        up, down = (float(f[-50:].mean()) for f in force)
        # Of the way the cells of the stiff ones that are not held take a little.
        strain = part * high / (high + 2 * (free + travel) / ratio)
        found = up / (YOUNG * strain * wide * DX)
        return bounded("force, of the bar's", found, 0.85, 1.05) or bounded(
            "difference of both forces, of one", abs(up + down) / up, 0.0, 0.01
        )

    return Trial(scene=scene, until=20 * passage, watch=watch, judge=judge, pieces=40)


# ---- friction -----------------------------------------------------------------------------------

#: Until when gravity presses a slab on, and from when it pulls along, s: eight periods in which it
#: would lift, and three after them.
PRESSED, PULLED = 0.25, 0.35


def _slab(
    coefficient: float, part: float, within: float, cfl: float = 0.4
) -> tuple[libmpm.Scene, float, float]:
    """Return a slab of 24 x 2 cells on a body of 56 x 4 cells, and gravity along and across that.

    The face is `part` times as steep as it must be to slide, and gravity is all there `within` so
    many seconds after it has begun to pull.
    """
    angle = math.atan(part * coefficient)
    along, across = GRAVITY * math.sin(angle), GRAVITY * math.cos(angle)
    ends = [0.0, PRESSED, PULLED, PULLED + within, 100.0]
    pull = libmpm.TimeTable(
        time=ends, value=[[0.0, 0.0]] + [[0.0, -across]] * 2 + [[along, -across]] * 2
    )
    scene = domain("slab", (56, 12), gravity=pull, cfl=cfl)
    scene.add_body(name="lower", shape=cells(0, 0, size=(56, 4)), material=solid())
    scene.add_body(name="slab", shape=cells(8, 4, size=(24, 2)), material=solid())
    scene.add_boundary(
        name="walls", shape=shapes.DomainWalls(faces=("x-", "x+", "y-")),
        response={"x-": boundaries.Slip(), "x+": boundaries.Slip(), "y-": boundaries.Sticky()},
    )  # fmt: skip
    law = contacts.Friction(static=coefficient)
    scene.add_contact(name="sole", between=("lower", "slab"), law=law)
    scene.add_sensor(name="sole", sensor=sensors.ContactLoad(contact="sole"))
    return scene, along, across


def sliding(coefficient: float) -> Trial:
    """A slab slides on another body, on a face that is 1.5 times as steep as that needs.

    v_x + μ v_y grows by g_x - μ g_y exactly where all slides along a level face, and by no less;
    judged as friction with walls is (`extremes_solids.friction`), beyond μ = 2 by the bound alone.
    What gravity does not give, the sensor of the contact tells.
    """
    scene, along, across = _slab(coefficient, 1.5, 1e-6)
    begun: list[tuple[float, Numbers]] = []

    def watch(simulation: libmpm.Simulation) -> str:
        if not begun and simulation.time > 0.99 * PULLED:
            begun.append((simulation.time, mean(simulation, "slab", "velocity")))
        return ""

    def judge(simulation: libmpm.Simulation) -> str:
        start, before = begun[0]
        v = mean(simulation, "slab", "velocity") - before
        sole = simulation.sensors["sole"]
        ratio = sole.impulse("tangential") / sole.impulse("normal")
        length, push = after(simulation, "sole", start)
        t = float(length.sum())
        scale = max(along, 0.1 * across) * t
        left = (v[0] + coefficient * v[1] - (along - coefficient * across) * t) / scale
        pull = np.array([along, -across]) * t + push / (DENSITY * 24 * 2 * DX**2)
        told = float(np.abs(v - pull).max()) / (GRAVITY * t)
        most = 0.05 if coefficient <= 2 else 99.0
        return (
            bounded("speed beyond Coulomb's, of g t", float(left), -0.02, most)
            or bounded("tangential load, of the normal one", ratio, 0.0, coefficient + 1e-6)
            or bounded("impulse told, beside g t", told, 0.0, rounding(simulation))
        )

    return Trial(scene=scene, until=2 * PULLED, watch=watch, judge=judge)


def sticking(coefficient: float, cfl: float = 0.4) -> Trial:
    """The same slab on a face 0.8 times as steep as it must be to slide: it stays."""
    scene, _, _ = _slab(coefficient, 0.8, 0.25, cfl)

    def judge(simulation: libmpm.Simulation) -> str:
        v = mean(simulation, "slab", "velocity")
        scale = GRAVITY * simulation.time
        return bounded("speed, of g t", float(np.abs(v).max()) / scale, 0.0, 0.002)

    return Trial(scene=scene, until=2.5 * PULLED, judge=judge)


# ---- in water -----------------------------------------------------------------------------------


def immersed(ratio: float) -> Trial:
    """A block of `ratio` times water's density is let go under water: it rises or sinks.

    a = g (1 - ratio)/(ratio + C) at first, averaged over half a cell; C, the mass of the water that
    goes along, is 1.19 for a square in endless water and more between walls. Judged by C = 0.9 to
    6, half of what water that sticks needs (`extremes_solids.immersed`).
    """
    scene, until, scale = under_water(ratio, boundaries.Slip())
    scene.add_contact(name="wet", between=("water", "block"), law=contacts.Fluid())
    scene.add_sensor(name="wet", sensor=sensors.ContactLoad(contact="wet"))
    begun: list[float] = []

    def prepare(simulation: libmpm.Simulation) -> None:
        begun.append(float(mean(simulation, "block", "position")[1]))

    def judge(simulation: libmpm.Simulation) -> str:
        velocity = np.asarray(simulation.particles["block"]["velocity"])
        way = float(mean(simulation, "block", "position")[1]) - begun[0]
        found = 2 * way / simulation.time**2 / GRAVITY
        ends = sorted((1 - ratio) / (ratio + c) for c in (0.9, 6.0))
        middle = mean(simulation, "block", "velocity")
        rate = float(np.abs(velocity - middle).max()) / (GRAVITY * until)
        length, push = after(simulation, "wet", -1.0)
        pull = GRAVITY * float(length.sum())
        told = abs(float(middle[1]) + pull - push[1] / (DENSITY * ratio * (EDGE * DX) ** 2)) / pull
        return (
            bounded("acceleration, of g", found, ends[0] - 0.03, ends[1] + 0.03)
            or bounded("velocity within the block, of g t", rate, 0.0, 0.5)
            or bounded("impulse told, beside g t", told, 0.0, rounding(simulation))
        )

    gain = no_energy_gain(lambda columns: scale)
    return Trial(scene=scene, until=until, judge=first(judge, gain), prepare=prepare)


# ---- the axes -----------------------------------------------------------------------------------


AXES: tuple[Axis, ...] = (
    axis(
        "contact, stiffness", "1", "E of a block over that of one that flies at it", 1.0,
        (1.0, 1e4), (1.0, 1e7), lambda v: collision(stiffness=v), group="contact", limit=200.0,
        says="the speed is Mach 0.1 of the slower wave, here and in the next row",
    ),
    axis(
        "contact, density", "1", "of a block over that of one that flies at it", 1.0, (1e-3, 1e3),
        (1e-6, 1e6), lambda v: collision(density=v), group="contact",
    ),
    axis(
        "contact, speed", "Mach", "of a block that flies at another one", 0.1, (1e-3, 0.3),
        (1e-7, 10.0), lambda v: collision(mach=v), group="contact", warns="begin with velocities",
    ),
    axis(
        "contact, squeezed", "1", "what a soft block loses of its height between two 100 times as "
        "stiff", 0.1, (0.01, 0.5), (1e-4, 0.99), squeezed, group="contact",
        says="beyond, its edges turn and enter",
    ),
    axis(
        "contact, stiffness of two that squeeze", "1", "E over that of the block between them, "
        "which loses 0.3 of its height", 100.0, (1.0, 1e4), (1.0, 1e4),
        lambda v: squeezed(0.3, v), group="contact", limit=120.0, cheap=False,
    ),
    axis(
        "contact, sliding", "1", "friction of a slab on another body, 1.5 times too steep", 0.3,
        (0.01, 2.0), (1e-6, 10.0), sliding, group="contact", also=(0.0, 100.0),
        says="beyond 2 Coulomb's bound alone is asked for, as on walls",
    ),
    axis(
        "contact, sticking", "1", "friction of a slab on another body, 0.8 times as steep as it "
        "slides", 0.3, (0.01, 1.5), (1e-6, 10.0), sticking, group="contact", warns="static is",
    ),
    axis(
        "contact, sticking, cfl 0.2", "1", "the same in steps half as long", 0.3, (0.01, 2.0),
        (1e-6, 10.0), lambda v: sticking(v, 0.2), group="contact", warns="static is",
    ),
    axis(
        "contact, density of a block in water", "1", "let go under water", 0.5, (1e-3, 1e3),
        (1e-4, 1e4), immersed, group="contact", limit=120.0,
    ),
)  # fmt: skip
