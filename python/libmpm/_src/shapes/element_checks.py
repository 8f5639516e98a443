"""Which meshes of elements are refused: rows, orientation, flat, thin, loose, double, apart."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from libmpm._src.base.arrays import real_array
from libmpm._src.base.text import listed, marked
from libmpm._src.base.values import Checker, shown
from libmpm._src.shapes.element_topology import (
    Faces,
    Numbers,
    determinants,
    doubles,
    faces,
    longest_edges,
    parts,
    qualities,
)
from libmpm._src.shapes.solid import Array

__all__ = ["THIN", "check_mesh"]

#: Shortest height over longest edge below which an element is refused.
THIN = 0.1
#: Volume, over that of a cube of the longest edge, below which an element has none.
_FLAT = 1e-12
#: Distance, in shortest edges' order, below which two vertices are at one place.
_SAME = 1e-9
#: Elements that can be numbered in 32 bits.
_MOST = 2**31 - 1


def check_mesh(
    check: Checker, vertices: Any, elements: Any, dimension: int
) -> tuple[Array, Numbers] | None:
    """Return vertices (n, d) and elements (m, d + 1) of positive orientation.

    None where something is wrong, which is reported.
    """
    corner = _vertices(check, vertices, dimension)
    rows = _elements(check, elements, dimension + 1)
    if corner is None or rows is None or not _in_range(check, corner, rows):
        return None
    before = len(check.problems)
    size = determinants(corner, rows)
    flat = np.abs(size) <= _FLAT * longest_edges(corner, rows) ** dimension
    if flat.any():
        number = int(np.flatnonzero(flat)[0])
        what = "volume" if dimension == 3 else "area"
        check.fail(
            f"elements {marked(flat)} have no {what} (of the first {abs(size[number]):.3g} "
            f"times {1 / math.factorial(dimension):.3g}, its vertices {rows[number].tolist()}); "
            f"expected corners that are not in a {'plane' if dimension == 3 else 'line'}; remove "
            "them or mesh again"
        )
    turned = (size < 0) & ~flat
    rows[turned] = rows[turned][:, [*range(dimension - 1), dimension, dimension - 1]]
    _check_vertices(check, corner, rows)
    if flat.any():
        return None
    _check_neighbours(check, rows, faces(rows))
    quality = qualities(corner, rows)
    thin = quality < THIN
    if thin.any():
        worst = int(np.argmin(quality))
        check.fail(
            f"elements {marked(thin)} are thin: shortest height over longest edge down to "
            f"{quality[worst]:.3g} (element {worst}); expected ≥ {THIN:g}, since thinner ones are "
            "stiff and invert; mesh again with edges of one length, or improve the mesh in the "
            "mesher"
        )
    return (corner, rows) if len(check.problems) == before else None


def _vertices(check: Checker, given: Any, dimension: int) -> Array | None:
    try:
        found = real_array(given, "vertices")
    except (OverflowError, TypeError, ValueError):
        check.fail(f"vertices is {shown(given, 80)}; expected rows of {dimension} numbers in m")
        return None
    if found.ndim != 2 or found.shape[1] != dimension or len(found) <= dimension:
        other = {2: "shapes.Tetrahedra in 3D", 3: "shapes.Triangles in 2D"}[dimension]
        check.fail(
            f"vertices has the shape {found.shape}; expected (n, {dimension}) with n > {dimension} "
            f"in m; use {other}, or leave other columns out"
        )
        return None
    bad = ~np.isfinite(found).all(axis=1)
    if bad.any():
        check.fail(f"vertices {marked(bad)} are not finite; expected numbers in m; repair the mesh")
        return None
    return np.array(found, dtype=np.float64, order="C")


def _elements(check: Checker, given: Any, corners: int) -> Numbers | None:
    try:
        found = real_array(given, "elements")
    except (OverflowError, TypeError, ValueError):
        check.fail(f"elements is {shown(given, 80)}; expected rows of {corners} vertex numbers")
        return None
    if found.ndim != 2 or found.shape[1] != corners or not 0 < len(found) <= _MOST:
        check.fail(
            f"elements has the shape {found.shape}; expected (m, {corners}) with 1 ≤ m < 2^31: "
            f"the numbers of {corners} vertices an element; of elements of higher order take the "
            "corners"
        )
        return None
    whole = np.isfinite(found).all(axis=1) & (found == np.rint(found)).all(axis=1)
    if not whole.all():
        check.fail(
            f"elements {marked(~whole)} have numbers that are not whole; expected vertex numbers, "
            "counted from 0"
        )
        return None
    return found.astype(np.int64)


def _in_range(check: Checker, vertices: Array, elements: Numbers) -> bool:
    last = len(vertices) - 1
    out = ((elements < 0) | (elements > last)).any(axis=1)
    if out.any():
        hint = ""
        if elements.min() == 1 and elements.max() == last + 1:
            hint = "; they seem to count from 1: subtract 1, or read the file with `read`"
        check.fail(
            f"elements {marked(out)} have vertex numbers from {elements.min()} to "
            f"{elements.max()}; expected 0 to {last} with {last + 1} vertices{hint}"
        )
        return False
    ranked = np.sort(elements, axis=1)
    twice = (ranked[:, 1:] == ranked[:, :-1]).any(axis=1)
    if twice.any():
        check.fail(
            f"elements {marked(twice)} have a vertex twice; expected {elements.shape[1]} different "
            "ones; remove these elements"
        )
        return False
    return True


def _check_vertices(check: Checker, vertices: Array, elements: Numbers) -> None:
    loose = np.ones(len(vertices), dtype=bool)
    loose[elements] = False
    if loose.any():
        check.fail(
            f"vertices {marked(loose)} belong to no element; expected each to be a corner; leave "
            "them out (`read` does)"
        )
    size = float(np.ptp(vertices, axis=0).max())
    if 0 < _SAME * size < math.inf:
        first = doubles(vertices, _SAME * size)
        double = np.flatnonzero(first != np.arange(len(first)))
        if len(double):
            pairs = ", ".join(f"{first[i]} and {i}" for i in double[:3])
            check.fail(
                f"vertices {listed(double.tolist())} lie where others do (pairs {pairs}); expected "
                "one vertex a place, since elements that meet at two of them are apart; merge "
                "them, or read the file with weld=True"
            )


def _check_neighbours(check: Checker, elements: Numbers, found: Faces) -> None:
    d = elements.shape[1] - 1
    what = "face" if d == 3 else "edge"
    per = d + 1
    many = np.flatnonzero(found.times > 2)
    if len(many):
        which = np.unique(np.flatnonzero(np.isin(found.number, many)) // per)
        check.fail(
            f"elements {listed(which.tolist())} share a {what} of three or more; expected a {what} "
            "in one element or two; remove those that lie within others"
        )
    seen = np.zeros(len(found.times), dtype=np.int64)
    np.add.at(seen, found.number, found.side)
    folded = np.flatnonzero((found.times == 2) & (seen != 0))
    if len(folded):
        which = np.unique(np.flatnonzero(np.isin(found.number, folded)) // per)
        check.fail(
            f"elements {listed(which.tolist())} lie on the same side of a {what} that they share; "
            "expected one on either side: they overlap; remove one of each pair"
        )
    part = parts(len(elements), found)
    count = int(part.max()) + 1
    if count > 1:
        sizes = np.bincount(part)
        small = np.argsort(-sizes, kind="stable")[1:]
        which = np.flatnonzero(np.isin(part, small))
        check.fail(
            f"the mesh has {count} parts that no {what} joins, of "
            f"{listed(np.sort(sizes)[::-1].tolist())} elements; elements {listed(which.tolist())} "
            "are not of the largest; expected one part, since a body hangs together; give each "
            "part a body of its own (`read` takes part=0, 1, ...), or merge vertices with weld=True"
        )
