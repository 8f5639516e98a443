"""L² projections of fields and of particles' values, and their errors."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt

from libmpm._src.base.arguments import keywords_only
from libmpm._src.base.optional_packages import need
from libmpm._src.base.text import marked
from libmpm._src.base.values import Checker, shown
from libmpm._src.errors import SceneError
from libmpm._src.grids import plots
from libmpm._src.grids.bases import Lagrange
from libmpm._src.grids.functions import Evaluation, Field, Functions, places, sampled

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["Projection", "project"]

Floats = npt.NDArray[np.float64]

#: Part of the largest value or sum of a function up to which it is rounding: none is there.
_UNSEEN = 1e-12
#: Pivot of the matrix scaled to a diagonal of ones, up to which it is singular.
_SINGULAR = 1e-13

_LABEL = "grids.Functions.project"


class _Samples(NamedTuple):
    """What was projected: values with weights at places."""

    position: Floats
    weight: Floats
    value: Floats


class Projection:
    """A field Σ c_i φ_i, made by `Functions.project`."""

    label: ClassVar[str] = "grids.Projection"

    def __init__(
        self,
        functions: Functions,
        coefficients: Floats,
        field: Field | None = None,
        particles: _Samples | None = None,
    ) -> None:
        """Take coefficients (count,) or (count, k) and what they came from."""
        self._functions, self._coefficients = functions, coefficients
        self._coefficients.flags.writeable = False
        self._field, self._particles = field, particles

    def __repr__(self) -> str:
        """Return a short description."""
        return f"<{self.label} on {self._functions!r}>"

    @property
    def functions(self) -> Functions:
        """The functions."""
        return self._functions

    @property
    def coefficients(self) -> Floats:
        """Coefficients c, (count,) or (count, k), in the unit of the field; read-only."""
        return self._coefficients

    @keywords_only("grids.Projection.at", 1)
    def at(self, position: npt.ArrayLike) -> Floats:
        """Return the field (n,) or (n, k) at positions (n, 2) in m, all inside the grid."""
        return self._values(self._functions.evaluate(position))

    @keywords_only("grids.Projection.gradient", 1)
    def gradient(self, position: npt.ArrayLike) -> Floats:
        """Return the slopes (n, 2) or (n, k, 2), unit of the field per m, at positions (n, 2)."""
        here = self._functions.evaluate(position)
        slopes = (self._living(here)[..., None] * here.gradient[:, :, None]).sum(axis=1)
        return np.asarray(slopes.reshape(-1, *self._coefficients.shape[1:], 2))

    def _values(self, here: Evaluation) -> Floats:
        values = (self._living(here) * here.value[..., None]).sum(axis=1)
        return np.asarray(values.reshape(-1, *self._coefficients.shape[1:]))

    def _living(self, here: Evaluation) -> Floats:
        """Return the coefficients (n, k, columns) of functions, any for those that fill up."""
        return self._coefficients.reshape(len(self._coefficients), -1)[here.function]

    @keywords_only("grids.Projection.error", 1)
    def error(self, field: Field | None = None) -> float:
        """Return (∫ |Σ c_i φ_i - f|²)^½, unit of the field times m.

        `field` is f(x, y) as in `Functions.project`, by default the projected one; over the columns
        of fields with several, the sum is under the root. Raises `SceneError`.
        """
        return self._norms(field)[0]

    @keywords_only("grids.Projection.relative_error", 1)
    def relative_error(self, field: Field | None = None) -> float:
        """Return `error` as a part of (∫ |f|²)^½; infinite for f = 0."""
        difference, whole = self._norms(field)
        return difference / whole if whole > 0 else math.inf

    @property
    def particle_error(self) -> float:
        """(Σ_p w_p |Σ_i c_i φ_i(x_p) - f_p|² / Σ_p w_p)^½ over the projected particles.

        Raises `SceneError` if a field was projected.
        """
        if self._particles is None:
            raise SceneError(
                f"{self.label}: particle_error of a projected field; expected a projection of "
                "particles' values; use error()"
            )
        position, weight, value = self._particles
        total = 0.0
        for rows, here in self._functions.batches(position):
            total += _square(self._values(here) - value[rows], weight[rows])
        return math.sqrt(total / float(weight.sum()))

    def _norms(self, field: Field | None) -> tuple[float, float]:
        field = self._field if field is None else field
        if field is None:
            raise SceneError(
                f"{self.label}: error() without a field, of a projection of particles' values; "
                "expected f(x, y); give it, or use particle_error"
            )
        position, weight = self._functions.quadrature
        difference = whole = 0.0
        for rows, here in self._functions.batches(position):
            wanted, have = sampled(self.label, field, position[rows]), self._values(here)
            if wanted.shape != have.shape:
                raise SceneError(
                    f"{self.label}: field(x, y) has shape {wanted.shape}; expected that of the "
                    f"projection, {have.shape}"
                )
            difference += _square(have - wanted, weight[rows])
            whole += _square(wanted, weight[rows])
        return math.sqrt(difference), math.sqrt(whole)

    def plot(self, ax: Axes | None = None, **style: Any) -> Axes:
        """Draw a field of one column as `Functions.plot` draws a function; return the axes."""
        return plots.plot_field(self._functions, self._coefficients, ax, **style)


def project(
    functions: Functions,
    field: Field | npt.ArrayLike,
    position: npt.ArrayLike | None,
    weight: npt.ArrayLike | None,
    mass: str,
) -> Projection:
    """Carry out `Functions.project`."""
    check = Checker(_LABEL)
    check.choice("mass", mass, ("consistent", "lumped"))
    basis = getattr(functions.grid, "basis", None)
    if mass == "lumped" and isinstance(basis, Lagrange) and basis.degree > 1:
        check.fail(
            f"mass is 'lumped' with {shown(basis)}, whose functions have sums that are zero or "
            "negative; expected 'consistent'"
        )
    if (position is None) != (weight is None):
        check.fail("position and weight: one is given; expected both for particles, or neither")
    if position is None and not callable(field):
        check.fail("values are given without position and weight; expected both, or a field")
    check.finish()
    if position is None or weight is None:
        assert callable(field)  # checked above
        where, area = functions.quadrature
        samples = _Samples(where, area, sampled(_LABEL, field, where))
        return Projection(functions, _coefficients(functions, samples, mass), field)
    samples = _particles(functions, field, places(_LABEL, position), weight)
    return Projection(functions, _coefficients(functions, samples, mass), particles=samples)


def _particles(
    functions: Functions, field: Field | npt.ArrayLike, position: Floats, weight: npt.ArrayLike
) -> _Samples:
    check = Checker(_LABEL)
    weights = np.asarray(weight, dtype=np.float64)
    if callable(field):
        values = sampled(_LABEL, field, position)
    else:
        values = np.asarray(field, dtype=np.float64)
    n = len(position)
    if weights.shape != (n,):
        check.fail(f"weight has shape {weights.shape} for {n} positions; expected ({n},)")
    elif not (np.isfinite(weights).all() and (weights >= 0).all() and weights.sum() > 0):
        check.fail("weight has entries that are negative or not finite, or is 0; expected ≥ 0")
    if values.ndim not in (1, 2) or len(values) != n:
        check.fail(f"values have shape {values.shape} for {n} positions; expected ({n},) or (n, k)")
    elif not np.isfinite(values).all():
        wrong = ~np.isfinite(values.reshape(n, -1)).all(axis=1)
        check.fail(f"values {marked(wrong)} are not finite; expected numbers")
    outside = functions.locate(position) < 0
    if outside.any():
        check.fail(
            f"positions {marked(outside)} lie outside the grid; expected all inside; remove them "
            "or enlarge the grid"
        )
    check.finish()
    return _Samples(position, weights, values)


def _coefficients(functions: Functions, samples: _Samples, mass: str) -> Floats:
    sparse = need("scipy.sparse", _LABEL)
    n, consistent = functions.count, mass == "consistent"
    value = samples.value.reshape(len(samples.value), -1)
    matrix: Any = sparse.csr_array((n, n))
    lumped, right = np.zeros(n), np.zeros((n, value.shape[1]))
    for rows, here in functions.batches(samples.position):
        count, width = here.value.shape
        start = np.arange(0, count * width + 1, width)
        column = np.maximum(here.function, 0).ravel()
        phi = sparse.csr_array((here.value.ravel(), column, start), shape=(count, n))
        weighted = (sparse.diags_array(samples.weight[rows]) @ phi).T.tocsr()
        right += weighted @ value[rows]
        if consistent:
            matrix = matrix + weighted @ phi
        else:
            lumped += weighted.sum(axis=1)
    if consistent:
        found = _solved(functions, matrix, right)
    else:
        seen = lumped > _UNSEEN * lumped.max()
        found = np.zeros_like(right)
        found[seen] = right[seen] / lumped[seen, None]
    return found.reshape(n, *samples.value.shape[1:])


def _solved(functions: Functions, matrix: Any, right: Floats) -> Floats:
    """Solve M c = b for the functions that are seen; the others get 0."""
    sparse, linalg = need("scipy.sparse", _LABEL), need("scipy.sparse.linalg", _LABEL)
    size = np.sqrt(matrix.diagonal())
    seen = np.flatnonzero(size > _UNSEEN * size.max())
    scale = sparse.diags_array(1 / size[seen])
    scaled = (scale @ matrix[seen][:, seen] @ scale).tocsc()
    try:
        # The matrix is symmetric and positive: no pivots, and an order for symmetric ones.
        factor = linalg.splu(
            scaled,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
        smallest = float(np.abs(factor.U.diagonal()).min())
    except RuntimeError:  # exactly singular
        smallest = 0.0
    if smallest < _SINGULAR:
        raise SceneError(
            f"{_LABEL}: the points do not determine the coefficients of the {len(seen)} of "
            f"{functions.count} functions that they see; expected more points in every cell; add "
            'particles or Gauss points, use a coarser grid, or mass="lumped"'
        )
    found = np.zeros_like(right)
    found[seen] = scale @ factor.solve(scale @ right[seen])
    return found


def _square(difference: Floats, weight: Floats) -> float:
    return float((weight * (difference.reshape(len(weight), -1) ** 2).sum(axis=1)).sum())
