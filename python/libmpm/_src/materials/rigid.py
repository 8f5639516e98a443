"""`Rigid`: a body that moves as a whole, with a mass, an inertia and degrees of freedom."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np

from libmpm._src.base.axes import AXES
from libmpm._src.base.declarations import given
from libmpm._src.base.values import Checker, sequence, shown, value
from libmpm._src.materials.material import Entry, Material, Parameter

__all__ = ["Rigid"]

#: What else than an axis may be held.
ROTATION = "rotation"


@value
class Rigid(Material):
    """Rigid body: mass and inertia, six degrees of freedom (three in 2D), no strain and no wave.

    {fields}

    The mass is density times the volume of the shape; the inertia that of its particles, each a
    cube (a square in 2D) of its volume. A body of it has a field of velocities of its own, meets
    others by the laws of `Scene.add_contact`, and moves as one with bodies that no contact names
    together with it. Walls push it and never pull it, with the friction of their response; those of
    `Sticky` hold what is pressed against them. It does not shorten the time step; a scene of rigid
    bodies alone needs `Method(time_step=)`. `sensors.RigidMotion` follows it.

    Not built for CUDA devices and several ranks, elements, F-bar and smoothing, kernels other than
    plain quadratic splines, XPIC and FMPM, mirrored walls; a run that has one can't be branched.
    Raises `SceneError`.
    """

    label: ClassVar[str] = "materials.Rigid"
    table: ClassVar[Entry] = Entry(
        name="Rigid",
        summary="Rigid body: mass and inertia, six degrees of freedom, no strain and no wave",
        source="Newton's and Euler's laws of motion",
        needs="nothing",
        columns=(),
        fbar=False,
        parameters=(
            Parameter(
                name="density",
                symbol="ρ",
                unit="kg/m³",
                default=None,
                lower=0.0,
                upper=math.inf,
                lower_open=True,
                upper_open=True,
                meaning="density",
            ),
        ),
    )

    density: float = given("mass over the volume of the shape", unit="kg/m³", above=0)
    inertia: float | Sequence[Sequence[float]] | None = given(
        "about the centre of mass, on the axes of the scene at the start: in 2D a number, kg·m² of "
        "a metre's thickness; in 3D a symmetric positive 3 x 3 matrix, kg·m²; None = that of the "
        "particles",
        default=None,
        unit="kg·m²",
        range="> 0",
    )
    held: Sequence[str] = given(
        'degrees of freedom in which it moves on as it began: "x", "y", "z", "rotation"',
        default=(),
        range="names",
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        found = super()._check(check)
        names = (self.held,) if isinstance(self.held, str) else sequence(self.held)
        known = (*AXES, ROTATION)
        held = tuple(names or ())
        if names is None or any(name not in known for name in held) or len(set(held)) < len(held):
            check.fail(
                f"held is {shown(self.held)}; expected some of {', '.join(known)}, each once; "
                'give ("rotation",), or leave it out'
            )
            held = ()
        return found | {"held": held, "inertia": self._inertia(check)}

    def _inertia(self, check: Checker) -> float | tuple[tuple[float, ...], ...] | None:
        given_ = self.inertia
        if given_ is None:
            return None
        if isinstance(given_, int | float):
            return check.number("inertia", given_, lower=0, lower_open=True, unit="kg·m²")
        try:
            matrix = np.asarray(given_, dtype=np.float64)
        except (TypeError, ValueError):
            matrix = np.zeros(0)
        whole = matrix.shape == (3, 3) and bool(np.isfinite(matrix).all())
        if whole and np.allclose(matrix, matrix.T, rtol=1e-9, atol=0):
            values = np.linalg.eigvalsh(matrix)
            # No mass has less about two axes together than about the third.
            if values[0] > 0 and values[2] <= (values[0] + values[1]) * (1 + 1e-9):
                return tuple(tuple(float(x) for x in row) for row in matrix)
        check.fail(
            f"inertia is {shown(given_)}; expected a number > 0 in 2D, or in 3D a symmetric 3 x 3 "
            "matrix whose principal values are > 0 and none more than the other two together; "
            "correct it, or leave it out"
        )
        return None

    def rigid_part(self, dimension: int) -> dict[str, Any]:
        """Return what the engine takes of it beside the parameters."""
        given_ = self.inertia
        numbers = [] if given_ is None else np.ravel(np.asarray(given_, dtype=np.float64)).tolist()
        held = [AXES.index(name) for name in self.held if name != ROTATION]
        return {"rigid": {"inertia": numbers, "held": held, "held_turn": ROTATION in self.held}}

    def misfits(self, dimension: int) -> list[str]:
        """Return what of it does not fit a scene of 2 or 3 dimensions."""
        out = []
        if self.inertia is not None and isinstance(self.inertia, float) != (dimension == 2):
            want = "a number" if dimension == 2 else "a 3 x 3 matrix"
            out.append(
                f"inertia of Rigid is {shown(self.inertia)} in {dimension}D; expected {want}; "
                "correct it, or leave it out"
            )
        if dimension == 2 and "z" in self.held:
            out.append("held of Rigid has 'z' in 2D; expected x, y or rotation; leave it out")
        return out
