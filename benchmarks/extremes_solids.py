"""Axes of solids: one number of a small scene with solids at its extremes.

Each scene has a closed form or a balance that must hold, so that what breaks silently is seen: the
period of a bar, Coulomb's bound, layers at rest under their own weight, the momentum of what
collides. Turns and large strains are in `extremes_motion`, sizes in `extremes_widths`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from extremes_axis import Axis, Trial, bounded, energies, first, no_energy_gain

import libmpm
from libmpm import boundaries, materials, sensors, shapes
from libmpm._src.base.formulas import Field

DENSITY = 1000.0  # kg/m³
GRAVITY = 9.81  # m/s²
DX = 0.05  # m
YOUNG = 1e6  # Pa
POISSON = 0.3
DOWN = (0.0, -GRAVITY)

#: Every solid of `libmpm.materials`; `LinearElastic` knows small strains alone.
SOLIDS = (
    "FixedCorotated", "NeoHookean", "StVenantKirchhoffHencky", "VonMises", "DruckerPrager",
    "CamClay", "Hypoelastic", "LinearElastic",
)  # fmt: skip


def solid(
    name: str = "NeoHookean", *, density: float = DENSITY, young: float = YOUNG,
    poisson: float = POISSON,
) -> materials.NeoHookean:  # fmt: skip
    """Return a solid of a name; those that flow do so at 1 % of E, or hardly stand tension."""
    more: Mapping[str, Any] = {
        "VonMises": {"yield_stress": 0.01 * young},
        "CamClay": {"log_plastic_volume": -0.01},
    }.get(name, {})
    make = getattr(materials, name)
    return make(density=density, youngs_modulus=young, poissons_ratio=poisson, **more)


def wave_speed(young: float = YOUNG, poisson: float = POISSON, density: float = DENSITY) -> float:
    """Return the speed of the pressure wave, m/s."""
    modulus = young * (1 - poisson) / ((1 + poisson) * (1 - 2 * poisson))
    return math.sqrt(modulus / density)


def domain(name: str, cells: tuple[int, ...], walls: Any = None, **options: Any) -> libmpm.Scene:
    """Return an empty domain of so many cells, with walls all round if a response is given."""
    dx = options.pop("cell_size", DX)
    scene = libmpm.Scene(
        name=name, dimension=len(cells), cell_size=dx, lower=(0.0,) * len(cells),
        upper=tuple(n * dx for n in cells), method=libmpm.Method(cfl=options.pop("cfl", 0.4)),
        **options,
    )  # fmt: skip
    if walls is not None:
        scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=walls)
    return scene


def cells(*corner: float, size: tuple[float, ...], dx: float = DX) -> shapes.Box:
    """Return a box by its lower corner and size in cells."""
    upper = tuple((a + s) * dx for a, s in zip(corner, size, strict=True))
    return shapes.Box(lower=tuple(a * dx for a in corner), upper=upper)


# ---- elasticity ---------------------------------------------------------------------------------


def bar(
    poisson: float = POISSON, fbar: libmpm.FBar | None = None, young: float = YOUNG,
    per_cell: int = 4,
) -> Trial:  # fmt: skip
    """A free bar in plane strain vibrates along itself with Love's period.

    T = 2 L/c √(1 + (ν' k h)²/12), c² = E/((1 - ν²) ρ), ν' = ν/(1 - ν), k = π/L: a lock of the
    volume would make it stiffer. Kinetic energy, which is all there is at the start, never exceeds
    that by more than 1 %.
    """
    length, high, speed = 16, 4, 1e-3
    along = math.sqrt(young / (1 - poisson**2) / DENSITY)
    k, across = math.pi / (length * DX), poisson / (1 - poisson)
    period = 2 * length * DX / along * math.sqrt(1 + (across * k * high * DX) ** 2 / 12)
    scene = domain("bar", (length + 8, high + 8), cfl=0.2)
    x, y = f"{k!r} * (x - {(4 + length / 2) * DX!r})", f"(y - {(4 + high / 2) * DX!r})"
    v = speed * along
    u = f"{v!r} * sin({x})"
    w = f"0 - {v * across * k!r} * cos({x}) * {y}" if across >= 0 else (
        f"{-v * across * k!r} * cos({x}) * {y}"
    )  # fmt: skip
    scene.add_body(
        name="bar", shape=cells(4, 4, size=(length, high)), fbar=fbar,
        material=solid(poisson=poisson, young=young), velocity=Field(components=(u, w)),
        particles_per_cell=per_cell,
    )  # fmt: skip
    scene.add_sensor(name="energy", sensor=sensors.Energy())

    def judge(simulation: libmpm.Simulation) -> str:
        kinetic = energies(simulation)["kinetic"]
        kinetic = kinetic / kinetic[0]
        time = np.asarray(simulation.sensors["energy"].time) / period
        # Times of rest: the first and the second fall to nothing, half a period apart.
        least = []
        for part in (0.25, 0.75):
            near = np.abs(time - part) < 0.15
            fit = np.polyfit(time[near], kinetic[near], 2)
            least.append(-fit[1] / (2 * fit[0]))
        found = 2 * (least[1] - least[0])
        return bounded("largest kinetic energy, of its start", kinetic.max(), 0, 1.01) or bounded(
            "period, of Love's", found, 0.9, 1.1
        )

    return Trial(scene=scene, until=period, judge=judge)


# ---- contact with walls -------------------------------------------------------------------------


def impact(speed: float, name: str = "FixedCorotated") -> Trial:
    """A steel block (E 200 GPa, 7850 kg/m³) of 8 x 4 cells meets a wall and comes back.

    What the wall gives is the change of the block's momentum; energy does not grow; nothing passes
    the wall.
    """
    young, density = 2e11, 7850.0
    c = wave_speed(young, POISSON, density)
    scene = domain("impact", (28, 12))
    material = solid(name, young=young, density=density)
    scene.add_body(
        name="block", shape=cells(0, 4, size=(8, 4)), material=material, velocity=(-speed, 0.0)
    )
    scene.add_boundary(
        name="wall",
        shape=shapes.DomainWalls(faces=("x-",)),
        response=boundaries.Separable(cell="held"),
    )
    until = 6 * 8 * DX / c
    scene.add_sensor(name="energy", sensor=sensors.Energy(interval=until / 200))
    scene.add_sensor(name="load", sensor=sensors.LoadCell(boundary="wall", interval=until))
    mass = density * 32 * DX**2

    def judge(simulation: libmpm.Simulation) -> str:
        read = simulation.particles["block"].read(["position", "velocity"])
        least = float(read["position"][:, 0].min()) / DX
        gained = mass * (float(read["velocity"][:, 0].mean()) + speed)
        load = simulation.sensors["load"]
        ends = np.asarray(load.time)
        given = float(abs((np.diff(ends, prepend=0.0) * np.asarray(load.values)[:, 0]).sum()))
        pending = simulation.time - float(ends[-1])  # no longer touching by then
        return (
            bounded("velocity back, of its own", gained / mass / speed - 1, -0.05, 1.0)
            or bounded("impulse of the wall, of the momentum gained", given / gained, 0.98, 1.02)
            or bounded("least distance from the wall, cells", least, 0, 99)
            or bounded("time after the last sample, of the run", pending / until, 0, 0.1)
        )  # fmt: skip

    gain = no_energy_gain(lambda columns: float(columns["kinetic"][0]))
    return Trial(scene=scene, until=until, judge=first(judge, gain))


def _slab(name: str, coefficient: float, part: float) -> tuple[libmpm.Scene, float, float]:
    """Return a slab of 24 x 2 cells on a plane, and gravity along and across that.

    The plane is `part` times as steep as it must be to slide.
    """
    angle = math.atan(part * coefficient)
    along, across = GRAVITY * math.sin(angle), GRAVITY * math.cos(angle)
    scene = domain(name, (64, 8), gravity=(along, -across))
    scene.add_body(name="slab", shape=cells(4, 0, size=(24, 2)), material=solid())
    rough = boundaries.Separable(static_friction=coefficient, dynamic_friction=coefficient)
    floor = shapes.DomainWalls(faces=("y-",))
    scene.add_boundary(name="floor", shape=floor, response=rough)
    return scene, along, across


def friction(coefficient: float) -> Trial:
    """A slab of 24 x 2 cells on a plane that is 1.5 times as steep as it must be to slide.

    Momentum: v_x + μ v_y = (g_x - μ g_y) t exactly if all that touches slides, and never less:
    friction is at most μ times the normal force. A steeper plane than μ = 2 makes an elastic slab
    hop and stick in places, where only the bound holds.
    """
    scene, along, across = _slab("sliding", coefficient, 1.5)

    def judge(simulation: libmpm.Simulation) -> str:
        v = simulation.particles["slab"]["velocity"].mean(axis=0)
        t = simulation.time
        scale = max(along, 0.1 * across) * t
        left = (v[0] + coefficient * v[1] - (along - coefficient * across) * t) / scale
        flat = coefficient <= 2
        return bounded("speed beyond Coulomb's, of g t", float(left), -0.02, 0.05 if flat else 99)

    return Trial(scene=scene, until=0.3, judge=judge)


def sticking(coefficient: float) -> Trial:
    """The same slab on a plane 0.8 times as steep as it must be to slide: it stays."""
    scene, _, _ = _slab("sticking", coefficient, 0.8)

    def judge(simulation: libmpm.Simulation) -> str:
        v = simulation.particles["slab"]["velocity"].mean(axis=0)
        scale = GRAVITY * simulation.time
        if coefficient > 2:  # it tips: its weight lies beyond its lower edge
            return bounded("speed, of g t", float(np.abs(v).max()) / scale, 0.0, 1.0)
        return bounded("speed, of g t", float(np.abs(v).max()) / scale, 0.0, 0.002)

    return Trial(scene=scene, until=0.3, judge=judge)


def swept(mach: float, response: Any = None) -> Trial:
    """A wall of 8 cells moves into a block at rest, at `mach` times its wave speed.

    At the end nothing has been passed by, and the block goes at the wall's speed at least.
    """
    speed = mach * wave_speed()
    scene = domain("swept", (60, 8), boundaries.Slip(cell="held"))
    scene.add_body(name="block", shape=cells(20, 2, size=(6, 4)), material=solid())
    scene.add_boundary(
        name="piston", shape=cells(8, 0, size=(8, 8)), motion=boundaries.Travel((speed, 0.0)),
        response=response or boundaries.Separable(cell="held"),
    )  # fmt: skip
    until = 14 * DX / speed

    def judge(simulation: libmpm.Simulation) -> str:
        read = simulation.particles["block"].read(["position", "velocity"])
        face = 16 * DX + speed * simulation.time
        least = (float(read["position"][:, 0].min()) - face) / DX
        mean = float(read["velocity"][:, 0].mean()) / speed
        return bounded("least place before the wall, cells", least, -0.5, 99) or bounded(
            "velocity, of the wall's", mean, 0.95, 2.05
        )

    return Trial(scene=scene, until=until, judge=judge)


# ---- solids with each other and with water ------------------------------------------------------


def contrast(ratio: float) -> Trial:
    """A soft block flies against one `ratio` ≥ 1 times as stiff; both are 4 x 2 cells.

    Masses are equal: momentum is kept, energy is not gained, and they move apart. The time of the
    soft one grows, in steps, with the root of the ratio: a million at 1e8.
    """
    soft = 1e4
    speed = 0.1 * wave_speed(soft)
    scene = domain("contrast", (24, 8))
    scene.add_body(
        name="soft", shape=cells(5, 3, size=(4, 2)), material=solid(young=soft),
        velocity=(speed, 0.0),
    )  # fmt: skip
    scene.add_body(
        name="stiff", shape=cells(10, 3, size=(4, 2)), material=solid(young=soft * ratio)
    )
    until = 2 * DX / speed + 6 * 4 * DX / wave_speed(soft)
    scene.add_sensor(name="energy", sensor=sensors.Energy(interval=until / 200))
    half = 0.5 * DENSITY * 8 * DX**2 * speed**2

    def judge(simulation: libmpm.Simulation) -> str:
        soft, stiff = (
            simulation.particles[b]["velocity"].mean(axis=0) / speed for b in ("soft", "stiff")
        )
        along, across = (soft + stiff).tolist()
        drift = 1e-3 + 1e-8 * simulation.steps  # of roundings that all go one way
        return (
            bounded("momentum along, of its start", along, 1 - drift, 1 + drift)
            or bounded("momentum across, of that along", across, -drift, drift)
            or bounded("velocity of the stiff one, of the soft one's", float(stiff[0]), 0.4, 1.01)
        )

    return Trial(
        scene=scene, until=until, judge=first(judge, no_energy_gain(lambda columns: half)),
    )  # fmt: skip


def layers(ratio: float, solid_above: bool = True, steps: int = 3000) -> Trial:
    """A solid of `ratio` times water's density lies on, or under, water across a narrow tank.

    Both press with what lies above them and are compressed by at most 2 %: the middles stay within
    2 % of the height, nothing gains energy, and what moves is a wave of that pressure.
    """
    wide, deep, thick, part = 4, 8, 4, 0.02
    depth, height, rho = deep * DX, thick * DX, DENSITY * ratio
    weight = (DENSITY * depth + rho * height) * GRAVITY
    own = rho * height * GRAVITY if solid_above else weight
    modulus = weight / part
    young = max(own / part, 1e-3 * modulus)
    scene = domain("layers", (wide, deep + thick + 4), boundaries.Mirror(), gravity=DOWN)
    at = (0, deep) if solid_above else (thick, 0)
    surface = at[0] * DX + depth + (ratio * height if solid_above else 0.0)
    scene.add_body(
        name="water", shape=cells(0, at[0], size=(wide, deep)), hydrostatic=surface,
        material=materials.TaitFluid(density=DENSITY, bulk_modulus=modulus),
    )  # fmt: skip
    scene.add_body(
        name="solid", shape=cells(0, at[1], size=(wide, thick)),
        material=solid(density=rho, young=young),
    )  # fmt: skip
    scene.add_sensor(name="energy", sensor=sensors.Energy())
    scale = weight * (deep + thick) * DX * wide * DX

    def judge(simulation: libmpm.Simulation) -> str:
        for name, low, size in (("water", at[0], deep), ("solid", at[1], thick)):
            middle = float(simulation.particles[name]["position"][:, 1].mean()) / DX
            fallen = (low + size / 2 - middle) / (deep + thick)
            said = bounded(f"fall of the {name}, of the height", fallen, -0.005, 0.02)
            if said:
                return said
        kinetic = energies(simulation)["kinetic"]
        return bounded("kinetic energy, of the weight", kinetic.max() / scale, 0.0, part)

    return Trial(
        scene=scene, steps=steps, judge=first(judge, no_energy_gain(lambda columns: scale))
    )


#: Of the block under water, cells.
EDGE = 8


def under_water(ratio: float, walls: boundaries.Response) -> tuple[libmpm.Scene, float, float]:
    """Return a block of `ratio` times water's density under it, how long it runs and its energy.

    Until it has moved by half a cell, as with 1.5 times the mass of its water going along, s; what
    lifts it by its edge, J/m.
    """
    wide, deep = 32, 28
    material = materials.TaitFluid(
        density=DENSITY, bulk_modulus=DENSITY * GRAVITY * deep * DX / 0.02
    )
    scene = domain("immersed", (wide, deep + 6), walls, gravity=DOWN)
    scene.add_body(
        name="water", shape=cells(0, 0, size=(wide, deep)), material=material, hydrostatic=deep * DX
    )
    pressure = DENSITY * GRAVITY * deep * DX * max(1.0, ratio)
    scene.add_body(
        name="block", shape=cells(12, 10, size=(EDGE, EDGE)), subtract_from=("water",),
        material=solid(density=DENSITY * ratio, young=pressure / 0.01),
    )  # fmt: skip
    pull = GRAVITY * abs(1 - ratio) / (ratio + 1.5)
    until = math.sqrt(2 * 0.5 * DX / max(pull, 0.01 * GRAVITY))
    scene.add_sensor(name="energy", sensor=sensors.Energy(interval=until / 50))
    return scene, until, DENSITY * max(1.0, ratio) * GRAVITY * (EDGE * DX) ** 3


def immersed(ratio: float) -> Trial:
    """A block of `ratio` times water's density is let go under water: it rises or sinks.

    a = g (1 - ratio)/(ratio + C) at first; C, the mass of the water that goes along, is 1.19 for a
    square in endless water and more between walls. On one velocity field a cell of water around the
    block sticks to it and shears the rest: at 8 cells across C is found 5 to 8, at 16 about half of
    that. So the judge is the direction, no more than C = 0.9 and no less than C = 12.
    """
    scene, until, scale = under_water(ratio, boundaries.Mirror())
    begun: list[float] = []

    def prepare(simulation: libmpm.Simulation) -> None:
        begun.append(float(simulation.particles["block"]["position"][:, 1].mean()))

    def judge(simulation: libmpm.Simulation) -> str:
        read = simulation.particles["block"].read(["position", "velocity"])
        way = float(read["position"][:, 1].mean()) - begun[0]
        found = 2 * way / simulation.time**2 / GRAVITY
        ends = sorted((1 - ratio) / (ratio + c) for c in (0.9, 12.0))
        rate = np.abs(read["velocity"] - read["velocity"].mean(axis=0)).max() / (GRAVITY * until)
        return bounded("acceleration, of g", found, ends[0] - 0.03, ends[1] + 0.03) or bounded(
            "velocity within the block, of g t", float(rate), 0.0, 0.5
        )

    gain = no_energy_gain(lambda columns: scale)
    return Trial(scene=scene, until=until, judge=first(judge, gain), prepare=prepare)


# ---- the axes -----------------------------------------------------------------------------------


def axis(
    name: str, unit: str, meaning: str, base: float, envelope: Any, reach: Any,
    build: Callable[[float], Trial], scale: Any = "log", *, group: str = "solid", **more: Any,
) -> Axis:  # fmt: skip
    """Return an axis of solids, its scale last, which most leave as it is."""
    return Axis(name, unit, meaning, base, envelope, reach, scale, build, group, **more)


FORMS = {
    "": None,
    ", F-bar": libmpm.FBar(),
    ", F-bar of two volumes": libmpm.FBar(form="two-volume", length=2 * DX),
}

AXES: tuple[Axis, ...] = (
    *(
        axis(
            f"Poisson's ratio{name}", "1", "of a bar that vibrates along itself", POISSON,
            (-0.5, 0.49), (-0.999, 0.49), lambda v, form=form: bar(v, form), "linear",
            also=(0.499, 0.4999, 0.49999), says="refused at 0.5; the step falls with √(1 - 2ν)",
        )
        for name, form in FORMS.items()
    ),
    axis(
        "density of a solid over water", "1", "across a tank, on the water", 1.0, (1e-3, 1e3),
        (1e-6, 1e6), layers,
    ),
    axis(
        "density of a solid under water", "1", "across a tank, below the water", 1.0, (1e-3, 1e3),
        (1e-6, 1e6), lambda v: layers(v, False),
    ),
    axis(
        "density of a block in water", "1", "let go under water", 0.5, (1e-3, 1e3), (1e-4, 1e4),
        immersed, limit=120.0, cheap=False,
    ),
    axis(
        "friction, sliding", "1", "of a slab on a plane 1.5 times too steep", 0.3, (0.01, 2.0),
        (1e-6, 10.0), friction, also=(0.0, 100.0),
        says="beyond 2 an elastic slab hops and sticks in places: Coulomb's bound alone holds",
    ),
    axis(
        "friction, sticking", "1", "of a slab on a plane 0.8 times as steep as it slides", 0.3,
        (0.01, 2.0), (1e-6, 10.0), sticking, also=(0.0, 100.0),
        says="beyond μ = 12/0.8 a slab of 24 x 2 cells tips",
    ),
    axis(
        "stiffness contrast", "1", "E of one of two blocks that collide, over the other's", 10.0,
        (1.0, 1e4), (1.0, 1e8), contrast, limit=120.0, cheap=False,
    ),
    axis(
        "impact of a solid", "m/s", "a steel block thrown at a wall", 10.0, (0.1, 1000.0),
        (1e-4, 1e5), impact, says="Mach 0.3 is 1760 m/s",
    ),
    axis(
        "wall into a solid", "Mach", "a wall that moves into a block at rest", 0.05, (1e-3, 0.3),
        (1e-3, 1e5), swept, says="refused where a wall would pass a cell in a step",
    ),
)  # fmt: skip

AXES += tuple(
    axis(
        f"Poisson's ratio, {n} per cell", "1", f"of a bar of {n} particles per cell", POISSON,
        (-0.5, 0.49), (-0.5, 0.49), lambda v, n=n: bar(v, per_cell=n), "linear",
        group="pairs of solids",
    )
    for n in (1, 64)
)  # fmt: skip
