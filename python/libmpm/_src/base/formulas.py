"""`Field`: values given by formulas of the coordinates, safe to read from a file."""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from libmpm._src.base.arguments import keywords_only
from libmpm._src.base.axes import AXES
from libmpm._src.base.declarations import OWNER, given
from libmpm._src.base.values import Checker, Value, nearest, sequence, shown, value
from libmpm._src.errors import SceneError

__all__ = ["Field"]

Floats = npt.NDArray[np.float64]

_CONSTANTS = {"pi": np.pi, "e": np.e}
_FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "tanh": np.tanh,
    "exp": np.exp,
    "log": np.log,
    "sqrt": np.sqrt,
    "abs": np.abs,
    "min": np.minimum,
    "max": np.maximum,
    "where": np.where,
}
#: Numbers of arguments; a NumPy function would take one too many for its output.
_ARITY = {"min": 2, "max": 2, "where": 3}
_OPERATORS: Mapping[type[ast.AST], Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}


@value
class Field(Value):
    """A field of vectors given by a formula for each component.

    {fields}

    A formula has numbers, + - * / **, comparisons, pi, e, and sin, cos, tan, tanh, exp, log, sqrt,
    abs, min, max, where(condition, yes, no); velocities are in m/s, stresses in Pa:
    ``Field(components=("0.1 * sin(pi * x / 25)", "0"))``.
    Nothing else is evaluated, so that a scene file cannot run code. Raises `SceneError`.
    """

    label: ClassVar[str] = "Field"

    components: Sequence[str] = given(
        "formulas of x, y and z in m, coordinates of the scene",
        unit="its own",
        shape="(k,)",
        scales=OWNER,
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        items = sequence(self.components)
        if not items or not all(isinstance(c, str) for c in items):
            check.fail(
                f"components is {shown(self.components)}; expected formulas as text, one a "
                "component"
            )
            return {"components": ("0",)}
        for i, formula in enumerate(items):
            try:
                _check_tree(ast.parse(formula.strip(), mode="eval").body)
            except (SyntaxError, RecursionError, MemoryError):
                check.fail(
                    f"components[{i}] is {shown(formula, 80)}, which is no formula; see Field"
                )
            except ValueError as error:
                check.fail(f"components[{i}] is {shown(formula, 80)}: {error}")
        return {"components": tuple(items)}

    def __len__(self) -> int:
        """Return the number of components."""
        return len(self.components)

    @keywords_only("Field.at", 2)
    def at(self, position: npt.ArrayLike, what: str = "Field") -> Floats:
        """Return the field at points (n, d) in m of the scene, float64 (n, k).

        Raises `SceneError` where a component is not finite or names a coordinate that the points
        do not have; `what` is named in it.
        """
        points = np.array(position, dtype=np.float64)
        out = self._values(points, what)
        for k, formula in enumerate(self.components):
            label = f"{what}: component {k}, {formula!r:.80},"
            wrong = np.flatnonzero(~np.isfinite(out[:, k]))
            if len(wrong):
                place = ", ".join(f"{x:g}" for x in points[wrong[0]])
                raise SceneError(
                    f"{label} is {out[wrong[0], k]:g} at ({place}) m; expected a finite number "
                    "wherever the body is"
                )
        return out

    def _values(self, points: Floats, what: str) -> Floats:
        """Return the field at points, finite or not."""
        if points.ndim != 2 or points.shape[1] > len(AXES):
            raise SceneError(f"{what}: points have the shape {points.shape}; expected (n, d) in m")
        names: dict[str, Any] = dict(zip(AXES, points.T, strict=False)) | _CONSTANTS
        out = np.empty((len(points), len(self.components)))
        for k, formula in enumerate(self.components):
            label = f"{what}: component {k}, {shown(formula, 80)},"
            try:
                with np.errstate(all="ignore"):
                    out[:, k] = _evaluate(ast.parse(formula.strip(), mode="eval").body, names)
            except ValueError as error:
                raise SceneError(f"{label} {error}") from error
            except (RecursionError, MemoryError) as error:
                raise SceneError(f"{label} is nested too deep to be evaluated") from error
        return out

    @keywords_only("Field.gradient", 3)
    def gradient(self, position: npt.ArrayLike, spacing: float, what: str = "Field") -> Floats:
        """Return how the field changes over a cell: float64 (n, k, d), [:, c, a] = ∂v_c/∂x_a.

        `position` (n, d) m, `spacing` > 0 the cell size, m. Of the differences over half a cell to
        either side it is the harmonic mean, and zero where they differ in sign or are not finite:
        exact for linear fields, of second order for smooth ones, and no jump within a cell becomes
        a slope. Raises `SceneError` as `at` does.

        Source: van Leer (1974), the limiter.
        """
        points = np.array(position, dtype=np.float64)
        here = self.at(points, what)
        out = np.zeros((*here.shape, points.shape[1]))
        half = 0.5 * spacing
        for a in range(points.shape[1]):
            sides = []
            for sign in (1.0, -1.0):
                moved = points.copy()
                moved[:, a] += sign * half
                way = moved[:, a] - points[:, a]  # as far as numbers let it
                with np.errstate(all="ignore"):
                    sides.append((self._values(moved, what) - here) / way[:, None])
            ahead, behind = sides
            with np.errstate(all="ignore"):
                product = ahead * behind
                slope = np.where(product > 0, 2 * product / (ahead + behind), 0.0)
            out[:, :, a] = np.where(np.isfinite(slope), slope, 0.0)
        return out

    def __call__(self, *coordinates: npt.ArrayLike) -> Floats:
        """Return the field at coordinates x, y, ...: (n,) of one component, else (n, k)."""
        values = self.at(np.column_stack([np.ravel(c) for c in coordinates]))
        return values[:, 0] if len(self) == 1 else values


def _check_tree(node: ast.AST) -> None:
    """Raise ValueError for anything but arithmetic."""
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        if isinstance(node.value, bool):
            raise ValueError(f"'{node.value}' is not arithmetic; see Field for what is")
        try:
            finite = math.isfinite(node.value)
        except OverflowError:
            finite = False
        if not finite:
            raise ValueError("a number is too large")
        return
    if isinstance(node, ast.Name):
        known = (*AXES, *_CONSTANTS)
        if node.id not in known:
            raise ValueError(f"unknown name '{node.id}'; {nearest(node.id, known)}")
        return
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
        if node.func.id not in _FUNCTIONS:
            raise ValueError(
                f"unknown function '{node.func.id}'; {nearest(node.func.id, _FUNCTIONS)}"
            )
        wanted = _ARITY.get(node.func.id, 1)
        if len(node.args) != wanted:
            raise ValueError(f"{node.func.id} has {len(node.args)} arguments; expected {wanted}")
        children: list[ast.AST] = list(node.args)
    elif isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
        children = [node.left, node.right]
    elif isinstance(node, ast.UnaryOp) and type(node.op) in _OPERATORS:
        children = [node.operand]
    elif isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in _OPERATORS:
        children = [node.left, node.comparators[0]]
    else:
        raise ValueError(f"'{ast.unparse(node)}' is not arithmetic; see Field for what is")
    for child in children:
        _check_tree(child)


def _evaluate(node: ast.AST, names: Mapping[str, Any]) -> Any:
    if isinstance(node, ast.Constant):
        # Python's own numbers would grow without end, raise, or turn complex.
        assert isinstance(node.value, int | float)
        return np.float64(node.value)
    if isinstance(node, ast.Name):
        if node.id not in names:
            raise ValueError(f"names '{node.id}', which is no coordinate of a plane scene")
        return names[node.id]
    if isinstance(node, ast.Call):
        assert isinstance(node.func, ast.Name)
        return _FUNCTIONS[node.func.id](*(_evaluate(a, names) for a in node.args))
    if isinstance(node, ast.BinOp):
        left, right = _evaluate(node.left, names), _evaluate(node.right, names)
        return _OPERATORS[type(node.op)](left, right)
    if isinstance(node, ast.UnaryOp):
        return _OPERATORS[type(node.op)](np.asarray(_evaluate(node.operand, names), float))
    assert isinstance(node, ast.Compare)
    left, right = _evaluate(node.left, names), _evaluate(node.comparators[0], names)
    return _OPERATORS[type(node.ops[0])](left, right)
