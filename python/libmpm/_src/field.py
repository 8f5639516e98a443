"""Fields given by formulas of the coordinates."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from libmpm._src.values import Checker, Value, nearest, sequence, value

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
_AXES = "xyz"


@value
class Field(Value):
    """A field of vectors given by a formula for each component.

    ==========  ====  =========  ==============================================================
    parameter   unit  shape      meaning
    ==========  ====  =========  ==============================================================
    components  text  (k,)       formulas of x, y and z in m, coordinates of the scene
    ==========  ====  =========  ==============================================================

    A formula has numbers, + - * / **, comparisons, pi, e, and sin, cos, tan, tanh, exp, log, sqrt,
    abs, min, max, where(condition, yes, no): ``Field(components=("0.1 * sin(pi * x / 25)", "0"))``.
    Nothing else is evaluated, so that a scene file cannot run code. Raises `SceneError`.
    """

    label: ClassVar[str] = "Field"

    components: Sequence[str]

    def _check(self, check: Checker) -> dict[str, Any]:
        items = sequence(self.components)
        if not items or not all(isinstance(c, str) for c in items):
            check.fail(
                f"components is {self.components!r}; expected formulas as text, one a component"
            )
            return {"components": ("0",)}
        for i, formula in enumerate(items):
            try:
                _check_tree(ast.parse(formula.strip(), mode="eval").body)
            except SyntaxError:
                check.fail(f"components[{i}] is {formula!r}, which is no formula; see Field")
            except ValueError as error:
                check.fail(f"components[{i}] is {formula!r}: {error}")
        return {"components": tuple(items)}

    def __len__(self) -> int:
        """Return the number of components."""
        return len(self.components)

    def at(self, position: npt.ArrayLike) -> Floats:
        """Return the field at points (n, d) in m of the scene, float64 (n, k)."""
        points = np.asarray(position, dtype=np.float64)
        names: dict[str, Any] = dict(zip(_AXES, points.T, strict=False)) | _CONSTANTS
        out = np.empty((len(points), len(self.components)))
        for k, formula in enumerate(self.components):
            out[:, k] = _evaluate(ast.parse(formula.strip(), mode="eval").body, names)
        return out


def _check_tree(node: ast.AST) -> None:
    """Raise ValueError for anything but arithmetic."""
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        return
    if isinstance(node, ast.Name):
        known = (*_AXES, *_CONSTANTS)
        if node.id not in known:
            raise ValueError(f"unknown name '{node.id}'; {nearest(node.id, known)}")
        return
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
        if node.func.id not in _FUNCTIONS:
            raise ValueError(
                f"unknown function '{node.func.id}'; {nearest(node.func.id, _FUNCTIONS)}"
            )
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
        return node.value
    if isinstance(node, ast.Name):
        if node.id not in names:
            raise ValueError(f"'{node.id}' is no coordinate of this scene")
        return names[node.id]
    if isinstance(node, ast.Call):
        assert isinstance(node.func, ast.Name)
        return _FUNCTIONS[node.func.id](*(_evaluate(a, names) for a in node.args))
    if isinstance(node, ast.BinOp):
        left, right = _evaluate(node.left, names), _evaluate(node.right, names)
        return _OPERATORS[type(node.op)](left, right)
    if isinstance(node, ast.UnaryOp):
        return _OPERATORS[type(node.op)](_evaluate(node.operand, names))
    assert isinstance(node, ast.Compare)
    left, right = _evaluate(node.left, names), _evaluate(node.comparators[0], names)
    return _OPERATORS[type(node.ops[0])](left, right)
