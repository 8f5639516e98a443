"""A debris as one mass on a nonlinear spring and dash-pot."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from libmpm._src.base.arguments import keywords_only
from libmpm._src.base.optional_packages import need
from libmpm._src.base.values import Checker
from libmpm._src.studies.design.arrays import Floats
from libmpm._src.studies.design.formula import Example, Numbers, Symbol, formula
from libmpm._src.studies.design.impact import MASS, SPEED, STIFFNESS

__all__ = ["Impact", "kelvin_voigt", "kelvin_voigt_peak"]

#: Debris B of the University of Washington's flume (WASIRF), at the speed of its impacts.
_DEBRIS_B = {"mass": 0.06555, "stiffness": 63_500.0, "velocity": 0.58}
#: Newton steps; each doubles the digits, from an error below 1.
_STEPS = 12
#: Tolerances of the equation of motion, in units of v √(m/k) and v.
_RELATIVE, _ABSOLUTE = 1e-11, 1e-14


@dataclass(frozen=True, eq=False, repr=False)
class Impact:
    """One impact of a debris, from first contact to release; made by `kelvin_voigt`."""

    label: ClassVar[str] = "design.Impact"

    time: Floats
    """Times since first contact, (n,) s."""
    displacement: Floats
    """Shortening x of the debris, (n,) m."""
    velocity: Floats
    """Its rate, (n,) m/s."""
    force: Floats
    """Force on the structure x (c x' + k), (n,) N, never negative."""
    peak: float
    """Largest force, N."""
    peak_time: float
    """When it acts, s."""
    duration: float
    """How long the debris stays in contact, s."""
    restitution: float
    """Speed after over speed before."""
    impulse: float
    """Impulse on the structure, N·s."""

    def __repr__(self) -> str:
        """Return the numbers without the history."""
        return (
            f"design.Impact(peak {self.peak:.5g} N at {self.peak_time:.4g} s, duration "
            f"{self.duration:.4g} s, restitution {self.restitution:.4g}, impulse "
            f"{self.impulse:.5g} N·s)"
        )


#: Samples of one contact.
_MOST_SAMPLES = 10_000_000


@keywords_only("design.kelvin_voigt", method=False)
def kelvin_voigt(
    *, mass: float, stiffness: float, velocity: float, damping: float = 0.0, samples: int = 201
) -> Impact:
    """Follow one impact of m x'' + x (c x' + k) = 0 from x = 0, x' = v until x = 0 again.

    =========  =======  =======  ==============================================================
    argument   unit     range    meaning
    =========  =======  =======  ==============================================================
    mass       kg       > 0      m, mass of the debris
    stiffness  N/m      > 0      k, for a bar E A / L
    velocity   m/s      > 0      v, speed at first contact
    damping    N·s/m²   ≥ 0      c; what counts is D = c v / k
    samples    1        ≥ 2      times of the history, evenly spaced
    =========  =======  =======  ==============================================================

    The history may step over a sharp peak; `peak` and the other numbers do not depend on `samples`.

    Without damping the pulse is half a sine of peak v √(m k), duration π √(m/k) and the full
    rebound. The peak exceeds v √(m k) for D > 1.19 only, and contact becomes longer with every D.
    How the damping ratios of the source's figure 6.6 follow from c is not printed.

    Raises `SceneError`. Source: Bonus (2023) eq. 6.5 (second form) to 6.8, there stepped with a
    semi-implicit Euler rule; here solved with error control.
    """
    check = Checker("design.kelvin_voigt")
    positive: dict[str, Any] = {"lower": 0, "lower_open": True}
    mass = check.number("mass", mass, unit="kg", **positive)
    stiffness = check.number("stiffness", stiffness, unit="N/m", **positive)
    velocity = check.number("velocity", velocity, unit="m/s", **positive)
    damping = check.number("damping", damping, lower=0, unit="N·s/m²")
    samples = check.integer("samples", samples, lower=2)
    if samples > _MOST_SAMPLES:
        check.fail(f"samples is {samples}; expected ≤ {_MOST_SAMPLES}, of one contact")
    check.finish()
    integrate = need("scipy.integrate", "design.kelvin_voigt", "studies")
    ratio = damping * velocity / stiffness

    def rate(_: float, state: Floats) -> list[float]:
        return [state[1], -state[0] * (ratio * state[1] + 1)]

    def released(_: float, state: Floats) -> float:
        return float(state[0])

    def highest(_: float, state: Floats) -> float:
        # d/dt of x (D x' + 1) is zero where x' = D x².
        return float(state[1] - ratio * state[0] ** 2)

    released.terminal, released.direction = True, -1  # type: ignore[attr-defined]
    highest.direction = -1  # type: ignore[attr-defined]
    found = integrate.solve_ivp(
        rate,
        (0.0, 10.0 + 4.0 * math.sqrt(1.0 + ratio)),  # release: at π for D = 0, √(2 D) for D → ∞
        [0.0, 1.0],
        method="LSODA",
        events=(released, highest),
        dense_output=True,
        rtol=_RELATIVE,
        atol=_ABSOLUTE,
    )
    if not all(len(times) for times in found.t_events):
        check.fail(
            f"damping is {damping:g} N·s/m², {ratio:.3g} of stiffness / velocity: no release was "
            "found; expected less; use a smaller damping"
        )
        check.finish()
    end, top = float(found.t_events[0][0]), float(found.t_events[1][0])
    place, speed = found.sol(np.linspace(0.0, end, samples))
    place[[0, -1]] = 0.0
    at_top, speed_at_top = found.y_events[1][0]
    restitution = -float(found.y_events[0][0][1])
    second, strength = math.sqrt(mass / stiffness), velocity * math.sqrt(mass * stiffness)
    return Impact(
        time=np.linspace(0.0, end, samples) * second,
        displacement=place * velocity * second,
        velocity=speed * velocity,
        force=strength * np.maximum(place * (ratio * speed + 1), 0.0),
        peak=strength * float(at_top * (ratio * speed_at_top + 1)),
        peak_time=top * second,
        duration=end * second,
        restitution=restitution,
        impulse=mass * velocity * (1 + restitution),
    )


@formula(
    "f = v √(m k) √(u/D) (D u + 1), D = c v / k, 3u/2 + ln((1 + D) / (1 + D u)) / D = 1",
    unit="N",
    symbols={
        "mass": MASS,
        "stiffness": STIFFNESS,
        "velocity": SPEED,
        "damping": Symbol("c", "N·s/m²", "damping", lower=0),
    },
    validity="short, stiff debris whose pulse is rounded; v √(m k) for c = 0",
    source="from Bonus (2023) eq. 6.5, m x'' + x (c x' + k) = 0; history by `kelvin_voigt`",
    examples=[
        Example(_DEBRIS_B, "37.42"),
        Example({"mass": 1, "stiffness": 1, "velocity": 1, "damping": 0.5}, "0.945"),
        Example({"mass": 1, "stiffness": 1, "velocity": 1, "damping": 10}, "1.873"),
    ],
)
def kelvin_voigt_peak(
    *, mass: Numbers, stiffness: Numbers, velocity: Numbers, damping: Numbers = 0.0
) -> Any:
    """Return the largest force of the impact that `kelvin_voigt` follows; u is x'/v at the peak."""
    ratio = damping * velocity / stiffness
    # Below, the peak differs from v √(m k) by less than D, and the logarithms cancel.
    damped = ratio > 1e-8
    d = np.where(damped, ratio, 1.0)
    speed = np.ones_like(d)
    # The left side minus the right is concave and falls: from u = 1 Newton's steps never overshoot.
    for _ in range(_STEPS):
        rest = 1 - 1.5 * speed - np.log1p(d * (1 - speed) / (1 + d * speed)) / d
        speed = speed - rest / (1 / (1 + d * speed) - 1.5)
    raised = np.sqrt(speed / d) * (d * speed + 1)
    return velocity * np.sqrt(mass * stiffness) * np.where(damped, raised, 1.0)
