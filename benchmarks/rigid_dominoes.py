"""How fast a row of dominoes falls, of bodies that are rigid but where they touch.

    python benchmarks/rigid_dominoes.py [--friction 0 0.3 0.6] [--restitution 0.01]

Every domino turns about its lower edge; the tip of each lies on the face of the next. There a
spring across the face, damped, and one along it give way, the latter up to Coulomb's bound:
elastic bodies stick before they slip (Maw, Barber, Fawcett 1976, Wear 38). Where two bodies of the
plane touch along a line the tractions p across and q along the surface give

    du_z/dx = -2 (1 - ν²) / (π E) ∫ p(s) / (x - s) ds,    du_x/dx = the same of q

(Johnson 1985, Contact mechanics, section 2.3), so both springs are as stiff as each other; of round
contacts in space the one along the face has 2 (1 - ν) / (2 - ν) of the other (Mindlin 1949). Row
"rigid" has none: friction is Coulomb's from the first moment of a blow, as of bodies that cannot
give way.

Prints the speed of the front from the eighth domino on, and of the pairs from the tenth to the
twentieth the impulse along the face over that across it, in the first 4 ms and from then until the
struck one has turned by 20 degrees.
"""

from __future__ import annotations

import argparse
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

    `along`: stiffness along the face over that across it; 0 = rigid.
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
    share = np.abs(impulse[:, 0, 9:20] / impulse[:, 1, 9:20]).mean(axis=1)
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
    parser.add_argument("--restitution", type=float, default=0.01)
    given = parser.parse_args()
    for friction in given.friction:
        for name, along in (("rigid", 0.0), ("2/3", 2 / 3), ("0.82", 0.82), ("1", 1.0)):
            found = front(friction, along, given.restitution)
            print(f"friction {friction:g}, {name}:", {k: round(v, 4) for k, v in found.items()})
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
