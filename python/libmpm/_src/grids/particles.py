"""Particles for grids of triangles: equal numbers in every element, and their areas."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from libmpm._src.base.optional_packages import need
from libmpm._src.base.text import marked
from libmpm._src.base.values import Checker
from libmpm._src.errors import SceneError
from libmpm._src.grids.mesh import Mesh

__all__ = ["subdivide", "voronoi_areas"]

Floats = npt.NDArray[np.float64]

#: Distance of the helping points that close the outer cells, in sizes of the mesh.
_FAR = 8.0
#: Distance of two points, in sizes of the mesh, at which they are one.
_SAME = 1e-12


def subdivide(corners: npt.ArrayLike, k: int) -> tuple[Floats, Floats]:
    """Cut each triangle into k² equal ones; return centroids (k² m, 2) and areas (k² m,), m and m².

    corners   m   (m, 3, 2)   corners of the triangles, in either direction
    k         -   ≥ 1         parts of every edge

    Triangle by triangle, row by row from the first edge on. Raises `SceneError`.
    Source: de Koster (2018) 2.4, an equal number of particles in every element.
    """
    check = Checker("subdivide")
    k = check.integer("k", k, lower=1, remedy="k² particles are placed in each triangle")
    given = np.asarray(corners, dtype=np.float64)
    if given.ndim != 3 or given.shape[1:] != (3, 2):
        check.fail(f"corners has shape {given.shape}; expected (m, 3, 2) in m")
    check.finish()
    # Thirds of a part: an upright triangle lies at (1, 1), one upside down at (2, 2).
    thirds = [
        (3 * i + up, 3 * j + up)
        for j in range(k)
        for i in range(k - j)
        for up in (1, 2)
        if i + j + up <= k
    ]
    along = np.array(thirds, dtype=np.float64) / (3 * k)
    first, edges = given[:, :1], given[:, 1:] - given[:, :1]
    # Written out, since a matrix product may depend on the number of threads.
    centroids = first + along[:, :1] * edges[:, None, 0] + along[:, 1:] * edges[:, None, 1]
    twice = edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0]
    return centroids.reshape(-1, 2), np.repeat(np.abs(twice) / (2 * k * k), k * k)


def voronoi_areas(points: npt.ArrayLike, mesh: Mesh) -> Floats:
    """Return the areas (n,) in m² of the Voronoi cells of points, clipped to a mesh.

    points   m   (n, 2)   n ≥ 1 different places inside the mesh or on its outline

    The areas add up to that of the mesh. Needs scipy and shapely:
    ``pip install libmpm[triangular]``. Raises `SceneError`, also without these.
    Source: de Koster (2018) 2.4, areas of irregular particles.
    """
    label = "voronoi_areas"
    spatial, shapely = need("scipy.spatial", label), need("shapely", label)
    places = np.asarray(points, dtype=np.float64)
    check = Checker(label)
    if places.ndim != 2 or places.shape[1] != 2 or not len(places):
        check.fail(f"points has shape {places.shape}; expected (n, 2) in m with n ≥ 1")
        check.finish()
    inside: npt.NDArray[np.bool_] = np.asarray(np.isfinite(places).all(axis=1))
    inside[inside] = mesh.contains(places[inside])
    if not inside.all():
        check.fail(
            f"points {marked(~inside)} lie outside the mesh; expected all inside; remove them or "
            "enlarge the mesh"
        )
        check.finish()
    low, high = np.array(mesh.lower), np.array(mesh.upper)
    size = float(np.hypot(*(high - low)))
    near = places - low
    close, _ = spatial.KDTree(near).query(near, k=[2])
    same = close[:, 0] <= _SAME * size
    if same.any():
        raise SceneError(
            f"{label}: points {marked(same)} have the place of another; expected different "
            "places; remove all but one"
        )
    # Far points on every side close all cells; the mesh is nearer to each of its own points.
    middle, far = (high - low) / 2, _FAR * size
    ring = middle + far * np.array([(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)])
    diagram = spatial.Voronoi(np.concatenate([near, ring]))
    around = [diagram.regions[r] for r in diagram.point_region[: len(near)]]
    owner = np.repeat(np.arange(len(near)), [len(a) for a in around])
    ends = diagram.vertices[np.concatenate(around)]
    cells = shapely.convex_hull(shapely.multipoints(ends, indices=owner))
    region = shapely.coverage_union_all(shapely.polygons(mesh.corners() - low))
    shapely.prepare(region)
    cut = ~shapely.contains_properly(region, cells)
    cells[cut] = shapely.intersection(cells[cut], region)
    return np.asarray(shapely.area(cells), dtype=np.float64)
