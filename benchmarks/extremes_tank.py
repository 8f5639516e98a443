"""The base scene of the axes of water: a gentle wave in a tank, all of it scaled by few numbers.

The base scene is `Tank()`: 16 cells of 0.05 m by 8 of water between mirrored walls that meet it, 6
cells of air above, ρ g H / K = 0.01, and the lowest standing wave of the tank in linear theory,
a velocity of 5 % of √(g H). It runs for half a period or `STEPS` steps, whichever is less.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from extremes_axis import Judge, Trial, bounded, first, no_energy_gain

import libmpm
from libmpm import boundaries, materials, sensors, shapes
from libmpm._src.base.formulas import Field

DENSITY = 1000.0  # kg/m³
GRAVITY = 9.81  # m/s²
EXPONENT = 7.15  # of the law
COMPRESSION = 0.01  # ρ g H / K of the base scene
STEPS = 2000
LOSS = 2e-4  # of a wave's velocity in a step, at most: what the transfer itself takes


@dataclass(frozen=True)
class Tank:
    """A rectangle of water with the lowest standing wave, all of it scaled by few numbers.

    Lengths are in cells; `bulk_modulus` None keeps `compression` = ρ g H / K. `wave` is the largest
    velocity in parts of √(g H); the free surface then moves by about that part of H.
    """

    cell_size: float = 0.05
    wide: int = 16
    deep: int = 8
    air: int = 6
    gravity: float = GRAVITY
    bulk_modulus: float | None = None
    compression: float = COMPRESSION
    viscosity: float = 0.001
    particles_per_cell: int = 4
    cfl: float = 0.4
    wave: float = 0.05
    origin: float = 0.0
    lower: float = 0.0
    steps: int = STEPS

    @property
    def width(self) -> float:
        """Width of the water, m."""
        return self.wide * self.cell_size

    @property
    def depth(self) -> float:
        """Depth of the water, m."""
        return self.deep * self.cell_size

    @property
    def modulus(self) -> float:
        """Bulk modulus, Pa."""
        if self.bulk_modulus is not None:
            return self.bulk_modulus
        return DENSITY * self.gravity * self.depth / self.compression

    @property
    def speed(self) -> float:
        """Largest velocity of the wave, m/s."""
        return self.wave * math.sqrt(self.gravity * self.depth)

    @property
    def frequency(self) -> float:
        """ω of the wave, 1/s: ω² = g k tanh(k H)."""
        k = math.pi / self.width
        return math.sqrt(self.gravity * k * math.tanh(k * self.depth))

    @property
    def time_step(self) -> float:
        """The stable step that a run takes, s: of the wave or of viscosity."""
        diffusion = 4 * self.viscosity / DENSITY / self.cell_size**2
        return self.cfl / max(math.sqrt(self.modulus / DENSITY) / self.cell_size, diffusion)

    @property
    def until(self) -> float:
        """How long it runs, s: half a period, or so many steps."""
        longest = self.steps * self.time_step
        return min(math.pi / self.frequency, longest) if self.gravity > 0 else longest

    def scene(self) -> libmpm.Scene:
        """Return the scene."""
        dx, low = self.cell_size, self.lower
        scene = libmpm.Scene(
            name="tank", dimension=2, cell_size=dx, lower=(low, low),
            upper=(low + self.width, low + (self.deep + self.air) * dx),
            origin=(self.origin, self.origin), gravity=(0.0, -self.gravity),
            method=libmpm.Method(cfl=self.cfl),
        )  # fmt: skip
        velocity: Any = (0.0, 0.0)
        if self.speed > 0:
            k = math.pi / self.width
            x, y = f"{k!r} * (x - {low!r})", f"{k!r} * (y - {low!r})"
            size = self.speed / math.cosh(k * self.depth)
            velocity = Field(
                components=(
                    f"{size!r} * (exp({y}) + exp(-({y}))) / 2 * sin({x})",
                    f"-{size!r} * (exp({y}) - exp(-({y}))) / 2 * cos({x})",
                )
            )
        scene.add_body(
            name="water",
            shape=shapes.Box(lower=(low, low), upper=(low + self.width, low + self.depth)),
            material=materials.TaitFluid(
                density=DENSITY, bulk_modulus=self.modulus, viscosity=self.viscosity
            ),
            particles_per_cell=self.particles_per_cell,
            velocity=velocity,
            hydrostatic=low + self.depth if self.gravity > 0 else None,
        )
        scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Mirror())
        scene.add_sensor(name="energy", sensor=sensors.Energy(interval=self.until / 50))
        return scene

    def trial(self) -> Trial:
        """Return the trial: energy, volume, level and the wave of linear theory."""
        if self.speed == 0:
            return self.rest(self.steps)
        judge = first(self.keeps_energy(), self.keeps_volume, self.follows_wave)
        return Trial(scene=self.scene(), until=self.until, judge=judge)

    def rest(self, steps: int) -> Trial:
        """Return the trial of a tank at rest: volume, level and residual speed."""
        judge = first(self.keeps_volume, self.rests)
        return Trial(scene=self.scene(), steps=steps, judge=judge)

    def rests(self, simulation: libmpm.Simulation) -> str:
        """The rms speed stays below 1e-3 √(g H), or of the wave speed without gravity."""
        velocity = simulation.particles["water"]["velocity"]
        scale = math.sqrt(self.gravity * self.depth or self.modulus / DENSITY)
        return bounded("rms speed", float(np.sqrt(np.mean(velocity**2))) / scale, 0.0, 1e-3)

    def keeps_energy(self) -> Judge:
        """Energy does not exceed its start by more than 1 % of the water's weight above its bed."""
        weight = 0.5 * DENSITY * self.gravity * self.depth**2 * self.width
        return no_energy_gain(lambda columns: weight)

    def keeps_volume(self, simulation: libmpm.Simulation) -> str:
        """The volume stays within 1 % of hydrostatic, and the height of the middle within 2 %."""
        read = simulation.particles["water"].read(["volume_ratio", "position"])
        r, n = DENSITY * self.gravity * self.depth / self.modulus, EXPONENT
        # Mean of (1 + γ ρ g y/K)^(-1/γ), which loses its digits at small compression.
        at_rest = 1 - r / 2
        if r > 1e-4:
            at_rest = ((1 + n * r) ** (1 - 1 / n) - 1) / (r * (n - 1))
        volume = float(np.mean(read["volume_ratio"]))
        # The fill is not compressed where its state is, so it sinks by some ρ g H/K.
        slack = 0.01 + 0.1 * r
        said = bounded("volume", volume, at_rest - slack, at_rest + slack)
        middle = float(np.mean(read["position"][:, 1]) - self.origin - self.lower)
        return said or bounded(
            "height of the middle", middle / self.depth, 0.48 - 0.5 * min(r, 0.9), 0.52, "H"
        )

    def follows_wave(self, simulation: libmpm.Simulation) -> str:
        """The mean velocity along the tank is that of the linear wave.

        It begins with 2/π tanh(kH)/(kH) of the largest velocity and goes with cos(ω t). Allowed are
        a tenth, what the transfer takes, which is a loss in every step, and viscosity, which takes
        1 - exp(-2 ν k² t).
        """
        t, w, k = simulation.time, self.frequency, math.pi / self.width
        mean = self.speed * 2 / math.pi * math.tanh(k * self.depth) / (k * self.depth)
        velocity = float(np.mean(simulation.particles["water"]["velocity"][:, 0]))
        viscous = -math.expm1(-2 * self.viscosity / DENSITY * k * k * t)
        slack = 0.1 + LOSS * simulation.steps + 1.1 * viscous
        low, high = math.cos(w * t) - slack, math.cos(w * t) + slack
        return bounded("mean velocity", velocity / mean, low, high, "of the wave")
