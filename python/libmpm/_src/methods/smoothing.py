"""`Smoothing` and `AssumedFields` over cells, and the same operators for arrays."""

from __future__ import annotations

import dataclasses
import importlib
from typing import Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt

from libmpm._src.base.arguments import keywords_only
from libmpm._src.base.declarations import given
from libmpm._src.base.values import Checker, Value, shown, value
from libmpm._src.errors import NumericalError

__all__ = ["METHODS", "AssumedFields", "Smoothed", "Smoothing", "smooth"]

METHODS = ("C0", "C1", "NB", "F0", "F0L1", "F0L2", "F0A", "F0AL1", "F0AL2", "F1")

#: Of the energy: more than this is not rounding.
_ROUNDING = 1e-12


@value
class Smoothing(Value):
    """Smoothing of a body's state over cells, once a step, before the step strains it.

    The smoothed field q̂ replaces what particles store: q ← q̂(x) + Δt q̇.

    {fields}

    With the mass m and centre of mass x_o of a cell's particles, q₀ = Σ m q / Σ m their mean,
    q₁ the slopes of their least squares, I the second moment of mass along an axis, and
    n = 2 d for the number of faces:

    - "C0": q̂ = q₀. "C1": q̂ = q₀ + q₁ · (x - x_o), without the directions in which a cell's
      particles do not spread.
    - "NB": q̂ᵢ = Σ m Nᵢ q / Σ m Nᵢ at nodes, q̂(x) = Σ Nᵢ q̂ᵢ, by the scene's functions.
    - "F0": q₀ of both cells at a face changes by ∓ F / (n m), F = γ M_r (q₀⁻ - q₀⁺),
      M_r = m⁻ m⁺ / (m⁻ + m⁺). "L1" and "L2" let flow only what the cells' slopes, or parabolas,
      do not explain of the jump; "A" opens a face only where one of its cells is an extremum;
      "AL1" and "AL2" do both. "F0AL1" is the author's choice for fluids.
    - "F1": of lines in both cells, F = B J / 2 with their jump J at the face.

    Cells are the spans between the knots of the scene's functions: around the nodes for quadratic
    ones, between them for all others. No form raises Σ m q²: `Simulation.smoothing` has what each
    call did. All but C0 and C1 spread q over cells call by call, so that more, shorter steps smooth
    more. Instead of F-bar; on the CPU in the phased step, on CUDA before any step, with sums that
    are integers (``docs/smoothing.md``). Raises `SceneError`.

    Source: Yang (2016) 3.3 to 3.5.
    """

    label: ClassVar[str] = "Smoothing"

    method: Literal["C0", "C1", "NB", "F0", "F0L1", "F0L2", "F0A", "F0AL1", "F0AL2", "F1"] = given(
        "the operator", default="F0AL1"
    )
    gamma: float | None = given(
        'share γ of the flux of "F0"; None = 1. The others find their own',
        default=None,
        unit="1",
        low=0,
        high=1,
    )
    field: Literal["volume", "strain"] | None = given(
        '"volume" (fluids: 1 - J) or "strain" (LinearElastic: the total one, component by '
        "component); None = what the material stores",
        default=None,
    )
    flux_length: Literal["face", "inertia"] = given(
        'of "F1": "face", the way from the centre of mass to the face, or "inertia", '
        "√(I/m), which does not keep linear fields",
        default="face",
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        method = check.choice("method", self.method, METHODS)
        gamma = self.gamma
        if gamma is not None:
            gamma = check.given("gamma", self, gamma)
            if method != "F0":
                check.fail(
                    f"gamma is {gamma:g} with method '{method}', which has none to give; leave it "
                    "out, or use 'F0'"
                )
        field: str | None = self.field
        if field is not None:
            field = check.choice("field", field, ("volume", "strain"))
        length = check.choice("flux_length", self.flux_length, ("face", "inertia"))
        if length != "face" and method != "F1":
            check.fail(
                f"flux_length is '{length}' with method '{method}', which has no lines to compare; "
                "leave it out, or use 'F1'"
            )
        return {"method": method, "gamma": gamma, "field": field, "flux_length": length}

    def specification(self, stores_volume: bool = True) -> dict[str, Any]:
        """Return the engine's specification; `stores_volume`: the material has a volume ratio."""
        return {
            "method": self.method,
            "gamma": 1.0 if self.gamma is None else self.gamma,
            "by_inertia": self.flux_length == "inertia",
            "field": self.field or ("volume" if stores_volume else "strain"),
        }


@value
class AssumedFields(Value):
    """Means of the rate of deformation and of the stress in place of each particle's (Hu-Washizu).

    Against locking: σ̃ = Σ m σ / Σ m before the internal force, d̃ = Σ m d / Σ m before the state
    advances.

    {fields}

    In plane strain the trace is that of the plane. Cells as of `Smoothing`, which it goes with; by
    transfers without an affine part; on the CPU. One mean a cell leaves zero-energy modes.
    Raises `SceneError`.

    Source: Yang (2016) 3.1, 3.2, eqs. (3.26), (3.27), (3.29), (3.30); without the rate (3.37),
    (3.39), (3.43).
    """

    label: ClassVar[str] = "AssumedFields"

    over: Literal["cell", "node"] = given(
        '"cell", one mean a cell, or "node", lumped means at nodes, interpolated: Σ m Nᵢ σ '
        "/ Σ m Nᵢ",
        default="cell",
    )
    part: Literal["volumetric", "deviatoric", "full"] = given(
        '"volumetric" (traces alone), "deviatoric" or "full" tensors', default="volumetric"
    )
    rate: bool = given(
        "False: of the stress alone. Every particle is strained by its own rate; where the "
        "law is linear in what it stores (LinearElastic), σ̃ = C : ε̃ with the mean ε̃ of "
        "the strains",
        default=True,
        range="bool",
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        check.instance("rate", self.rate, (bool,), "True or False")
        return {
            "over": check.choice("over", self.over, ("cell", "node")),
            "part": check.choice("part", self.part, ("volumetric", "deviatoric", "full")),
        }

    def specification(self) -> dict[str, Any]:
        """Return the engine's specification."""
        return {"over": self.over, "part": self.part, "rate": self.rate}


@dataclasses.dataclass(frozen=True)
class Smoothed:
    """What `smooth` made of a field.

    =============  ============  ============================================================
    attribute      shape         meaning
    =============  ============  ============================================================
    q              of the field  the smoothed field
    energy_change  (passes,)     change of Σ m q² by each pass, kg times the field's unit squared
    index          (passes,)     I_E after each pass: Σ m (q̂ - q̄)² over that before the first,
                                 less 1. 0: nothing is lost, -1: only the mean q̄ is left
    =============  ============  ============================================================
    """

    q: npt.NDArray[np.float64]
    energy_change: npt.NDArray[np.float64]
    index: npt.NDArray[np.float64]


@keywords_only("methods.smooth", 4, method=False)
def smooth(
    q: npt.ArrayLike,
    mass: npt.ArrayLike,
    position: npt.ArrayLike,
    cell_size: float,
    *,
    method: str | Smoothing = "F0AL1",
    passes: int = 1,
) -> Smoothed:
    """Return a field on points, smoothed over the cells they stand in.

    =========  ====  ===========  =============================================================
    parameter  unit  shape        meaning
    =========  ====  ===========  =============================================================
    q          any   (n,) (n, c)  the field; components are smoothed one by one
    mass       kg    (n,) or ()   of each point, > 0
    position   m     (n,) (n, d)  of the points, in one to three dimensions
    cell_size  m     > 0          of square cells, whose corners are multiples of it
    method     -     a method     `Smoothing`, or its method's name
    passes     1     ≥ 1          how often
    =========  ====  ===========  =============================================================

    The operators are those of `Smoothing`; "NB" has linear functions between the cells' corners. A
    cell without points is no neighbour. Raises `SceneError`, and `NumericalError` where a pass
    would add energy, which no form does.

    Source: Yang (2016) 3.3 to 3.5, I_E (3.185).
    """
    check = Checker("smooth")
    field = _array(check, "q", q, (1, 2))
    points = _array(check, "position", position, (1, 2))
    points = points[:, None] if points.ndim == 1 else points
    weights = _array(check, "mass", mass, (0, 1))
    size = check.number("cell_size", cell_size, lower=0, lower_open=True, unit="m")
    passes = check.integer("passes", passes, lower=1)
    if not check.problems:
        n = len(field)
        weights = np.broadcast_to(weights, (n,)) if weights.ndim == 0 else weights
        if n == 0 or len(points) != n or len(weights) != n:
            check.fail(
                f"q has {n} points, position {len(points)} and mass {len(weights)}; expected "
                "as many of each, and at least one"
            )
        elif not 1 <= points.shape[1] <= 3:
            check.fail(f"position has {points.shape[1]} axes; expected one to three")
        elif not (weights > 0).all():
            check.fail(f"mass has {weights.min():g}; expected > 0 kg")
        elif np.abs(points).max() > size * 1e15:
            check.fail("position is more than 1e15 cells from zero, where cells have no number")
    check.finish()
    if not isinstance(method, Smoothing):
        named: Any = method
        method = Smoothing(method=named)
    core = importlib.import_module("libmpm._core")
    smoothed, energy = core.smooth_points(
        field.reshape(len(field), -1),
        np.ascontiguousarray(weights),
        points,
        size,
        method.specification(),
        passes,
    )
    before, after, uniform = energy.T
    change = after - before
    # A uniform field changes by its rounding alone.
    if not (change <= _ROUNDING * before).all():
        worst = int(np.argmax(np.where(np.isnan(change), np.inf, change - _ROUNDING * before)))
        raise NumericalError(
            f"smoothing '{method.method}': pass {worst + 1} adds {change[worst]:g} to an energy of "
            f"{before[worst]:g}; expected no more than rounding"
        )
    about = before[0] - uniform[0]
    index = (after - uniform) / about - 1 if about > 1e-14 * before[0] else np.zeros(passes)
    return Smoothed(smoothed.reshape(field.shape), change, index)


def _array(
    check: Checker, name: str, given: npt.ArrayLike, dimensions: tuple[int, ...]
) -> npt.NDArray[np.float64]:
    try:
        array = np.ascontiguousarray(given, dtype=np.float64)
        array = array.reshape(np.shape(given))
    except (OverflowError, RecursionError, TypeError, ValueError):
        check.fail(f"{name} is {shown(given)}; expected an array of numbers")
        return np.zeros((1,) * dimensions[-1])
    if array.ndim not in dimensions:
        expected = " or ".join(str(d) for d in dimensions)
        check.fail(f"{name} has the shape {array.shape}; expected {expected} axes")
        return np.zeros((1,) * dimensions[-1])
    if not np.isfinite(array).all():
        check.fail(f"{name} has values that are not finite; remove them")
    return array


def history(rows: npt.NDArray[np.float64]) -> dict[str, npt.NDArray[np.float64]]:
    """Return the engine's rows by name, as `Simulation.smoothing` describes them."""
    names = ("time", "calls", "energy", "energy_change", "index")
    return dict(zip(names, rows.T, strict=True))
