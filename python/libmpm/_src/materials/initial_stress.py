"""Stresses that bodies start with (`add_body(stress=...)`), as what their materials store."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from libmpm._src.base.formulas import Field
from libmpm._src.base.values import Checker
from libmpm._src.errors import SceneError
from libmpm._src.shapes.element_mesh import ElementMesh

if TYPE_CHECKING:
    from libmpm._src.scene.data import SceneData
    from libmpm._src.scene.parts import Body

__all__ = ["PLANE", "SPACE", "check_stress", "stored_stress"]

Floats = npt.NDArray[np.float64]

#: Components of a stress in the plane, whose zz follows, and in space.
PLANE, SPACE = ("xx", "yy", "xy"), ("xx", "yy", "zz", "yz", "xz", "xy")
#: Components that are given, by material and dimension.
_GIVEN: dict[str, dict[int, tuple[str, ...]]] = {
    "Hypoelastic": {2: (*PLANE, "zz"), 3: SPACE},
    "LinearElastic": {2: PLANE, 3: SPACE},
}
#: Range of the volume ratio less 1 in which the engine takes a small strain.
_LEAST, _MOST = -0.95, 19.0


def check_stress(scene: SceneData, body: Body, check: Checker) -> None:
    """Refuse a stress of a body whose material has no state for it."""
    stress, table = body.stress, body.material.table
    if stress is None or isinstance(body.shape, ElementMesh):  # checks_elements.py
        return
    if table.name not in _GIVEN:
        known = " or ".join(_GIVEN)
        remedy = (
            "use hydrostatic, or remove stress"
            if table.stores_volume
            else f"use {known}, or remove stress and let the body come to rest under load"
        )
        check.fail(
            f"stress is given for {table.name}, whose law would have to be inverted for the state "
            f"that has it; expected {known} on square cells; {remedy}"
        )
        return
    for placed in scene.flows:
        if getattr(placed.flow, "body", None) == body.name:
            check.fail(
                f"stress is given, and inflow '{placed.name}' feeds the body; expected one of "
                "them: what flows in has no stress; remove stress, or feed another body"
            )
    names = _GIVEN[table.name][scene.dimension]
    if len(stress) != len(names):
        follows = "; zz follows as ν (xx + yy)" if names == PLANE else ""
        check.fail(
            f"stress has {len(stress)} components for {table.name} in {scene.dimension} "
            f"dimensions; expected {len(names)}: {', '.join(names)}{follows}"
        )
    elif table.name == "LinearElastic" and not isinstance(stress, Field):
        try:
            _strain(np.array([stress]), scene.dimension, body.material.parameters(), "stress")
        except SceneError as error:
            check.fail(str(error))


def stored_stress(
    scene: SceneData, body: Body, rows: Callable[[int, int], Floats], count: int
) -> dict[str, Any]:
    """Return the entries of an engine's body that make it start with its stress.

    Cauchy stress, Pa; `rows` gives positions from `Scene.lower`, m. Volume ratios of `Hypoelastic`
    count from this state; `LinearElastic` has the strain e of J σ = 2 μ e + λ tr(e) I, J = 1 +
    tr(e). Raises `SceneError`.
    """
    assert body.stress is not None
    where = f"body '{body.name}': stress"
    if isinstance(body.stress, Field):
        position = rows(0, count) + np.asarray(scene.lower, dtype=np.float64)
        stress = body.stress.at(position, where)
    else:
        stress = np.tile(np.asarray(body.stress, dtype=np.float64), (count, 1))
    if body.material.table.name == "Hypoelastic":
        state = np.column_stack([stress, np.zeros(count)])
    else:
        state = _strain(stress, scene.dimension, body.material.parameters(), where)
    return {"state": state, "state_width": state.shape[1]}


def _strain(stress: Floats, dimension: int, parameters: dict[str, float], where: str) -> Floats:
    """Return the small strains of Cauchy stresses (n, k), Pa; of axes as they are stored."""
    young, poisson = parameters["youngs_modulus"], parameters["poissons_ratio"]
    shear = young / (2 * (1 + poisson))
    lame = young * poisson / ((1 + poisson) * (1 - 2 * poisson))
    modulus = 2 * shear + dimension * lame
    # The trace of J σ = 2 μ e + λ tr(e) I, for tr(e).
    trace = stress[:, :dimension].sum(axis=1)
    with np.errstate(divide="ignore"):
        change = trace / (modulus - trace)
    wrong = np.flatnonzero(~((change > _LEAST) & (change < _MOST)))
    if len(wrong):
        least, most = (modulus * c / (1 + c) for c in (_LEAST, _MOST))
        raise SceneError(
            f"{where} has the trace {trace[wrong[0]]:g} Pa, which no strain of LinearElastic with "
            f"these moduli has; expected {least:g} to {most:g} Pa; give a smaller stress"
        )
    kirchhoff = stress * (1 + change)[:, None]
    kirchhoff[:, :dimension] -= lame * change[:, None]
    found: Floats = kirchhoff / (2 * shear)
    return found
