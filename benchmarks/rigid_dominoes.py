"""How fast a row of rigid dominoes falls, by what a blow is taken for.

    python benchmarks/rigid_dominoes.py [--friction 0 0.3 0.6] [--restitution 0.01 0.5 0.7 0.9]

Every domino turns about its lower edge; the tip of each lies on the face of the next, with a stiff
spring and a dashpot across the face. Along it there is Coulomb's friction alone ("slides"), or a
spring that gives way up to Coulomb's bound, of a share of the stiffness across: 1 as of two bodies
of the plane that touch along a line (Johnson 1985, Contact mechanics, 2.4: tractions along a
half-plane move its surface by the integral that tractions across move it by; a tip is no
half-plane, so 2/3 and 2 are here too). The dashpot presses from the first moment of a blow, so that
without restitution a spring along the face sticks at first, which springs alone would not at
friction 0.3.

Prints the speed of the front from the eighth domino on, and of the pairs from the tenth to the
twentieth the impulse along the face over that across it, in the first 4 ms and from then until the
struck one has turned by 20 degrees: "nan" where one of them has left the other by then.
"""

from __future__ import annotations

import argparse
import itertools
import math
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from support.contact_scenes import HIGH, PITCH, THICK

COUNT = 24
GRAVITY = 9.81
STIFFNESS = 2e5  # N/m of a domino of 1 kg; ten times as much changes speeds by 0.001 m/s
STEP = 4e-6  # s
BEGIN = math.radians(12), 20.8  # angle and rate of the first, rad, rad/s
FALLEN = HIGH * (1 - 1e-3)  # of the highest point
BLOW = 4e-3  # s


def front(friction: float, along: float = 1.0, restitution: float = 0.01) -> dict[str, float]:
    """Return the speed of the front, m/s, and the impulse along faces over that across them.

    `along`: stiffness along the face over that across it; 0 = none, it slides. Raises
    `RuntimeError` where the row has not fallen after 4 s.
    """
    lost = -math.log(restitution)
    inertia = (THICK**2 + HIGH**2) / 3
    damping = 2 * lost / math.hypot(math.pi, lost) * math.sqrt(STIFFNESS / 6)
    angle, rate, fell = np.zeros(COUNT), np.zeros(COUNT), np.full(COUNT, np.nan)
    angle[0], rate[0] = BEGIN
    stretch = np.zeros(COUNT - 1)  # of the springs along faces, m
    struck = np.full(COUNT - 1, np.inf)
    impulse = np.zeros((2, 2, COUNT - 1))  # blow, then; along, across
    steps = 0
    while np.isnan(fell).any():
        time = steps * STEP
        steps += 1
        if not time < 4.0:
            raise RuntimeError(f"{np.isnan(fell).sum()} dominoes stand after {time:g} s")
        s, c = np.sin(angle), np.cos(angle)
        # Weight about the edge; a domino stands on its foot, and lies on the floor.
        torque = GRAVITY / 2 * (HIGH * s - THICK * c)
        stops = np.where(angle < 0, angle, np.maximum(angle - math.pi / 2, 0))
        torque -= np.where(stops != 0, 1e3 * stops + 0.3 * rate, 0)
        # The tip of each in the axes of the next: its face is at -THICK.
        x, y = HIGH * s[:-1] - PITCH, HIGH * c[:-1]
        deep = x * c[1:] - y * s[1:] + THICK
        up = x * s[1:] + y * c[1:]
        on = (deep > 0) & (up >= 0) & (up <= HIGH)
        slip_x = rate[:-1] * y - rate[1:] * y
        slip_y = -rate[:-1] * HIGH * s[:-1] + rate[1:] * x
        closing, sliding = slip_x * c[1:] - slip_y * s[1:], slip_x * s[1:] + slip_y * c[1:]
        across = np.where(on, np.maximum(STIFFNESS * deep + damping * closing, 0), 0)
        if along > 0:
            most = friction * across / (along * STIFFNESS)
            stretch = np.where(on, np.clip(stretch + sliding * STEP, -most, most), 0)
            rubs = along * STIFFNESS * stretch
        else:
            rubs = friction * across * np.tanh(sliding / 1e-3)
        force_x = -across * c[1:] - rubs * s[1:]
        force_y = across * s[1:] - rubs * c[1:]
        torque[:-1] += HIGH * (c[:-1] * force_x - s[:-1] * force_y)
        torque[1:] -= y * force_x - x * force_y
        struck = np.where(on & np.isinf(struck), time, struck)
        late = time >= struck + BLOW
        for k, part in enumerate((~late, late & (angle[1:] < math.radians(20)))):
            impulse[k] += np.where(part, (rubs, across), 0) * STEP
        rate += STEP * torque / inertia
        angle += STEP * rate
        top = np.maximum(HIGH * np.cos(angle), HIGH * np.cos(angle) + THICK * np.sin(angle))
        fell = np.where(np.isnan(fell) & (angle > 0.03) & (top < FALLEN), time, fell)
    with np.errstate(invalid="ignore"):  # of pairs that have parted by then there is none
        share = -(impulse[:, 0, 9:20] / impulse[:, 1, 9:20]).mean(axis=1)
    return {
        "speed": float((COUNT - 8) * PITCH / (fell[-1] - fell[7])),
        "along_first": float(share[0]),
        "along_then": float(share[1]),
    }


def main() -> int:
    """Do what the command line says."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("--friction", type=float, nargs="*", default=[0.0, 0.3, 0.6])
    parser.add_argument("--restitution", type=float, nargs="*", default=[0.01, 0.5, 0.7, 0.9])
    given = parser.parse_args()
    for friction, restitution in itertools.product(given.friction, given.restitution):
        for along in (0.0, 2 / 3, 1.0, 2.0) if friction > 0 else (0.0,):
            found = front(friction, along, restitution)
            name = f"spring {along:.2g}" if along else "slides"
            print(f"friction {friction:g}, restitution {restitution:g}, {name}:",
                  {k: round(v, 4) for k, v in found.items()}, flush=True)  # fmt: skip
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
