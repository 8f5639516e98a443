"""Outlines of shapes in a plane: bodies, boundaries, walls and zones of a scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgba
from matplotlib.patches import Polygon, Rectangle
from numpy.typing import NDArray

from libmpm._src.base.axes import AXES
from libmpm._src.base.palette import CYCLE, OUTLINE, STRUCTURE
from libmpm._src.boundaries.responses import Response
from libmpm._src.grids.shapes import Outline
from libmpm._src.pictures.mesh_outline import mesh_lines
from libmpm._src.shapes.boxes import Box, DomainWalls, OrientedBox, faces_of
from libmpm._src.shapes.element_mesh import ElementMesh

if TYPE_CHECKING:
    from libmpm._src.scene.data import SceneData

__all__ = [
    "MARGIN",
    "Plane",
    "draw_boundaries",
    "draw_domain",
    "draw_flows",
    "draw_shape",
    "sample_solid",
]

Array = NDArray[np.float64]

#: Points along the longest edge at which a solid's distance is looked at, in a plane and in space.
_IN_PLANE, _IN_SPACE = 200, 64

#: Room around the domain in pictures, as a share of its longer edge.
MARGIN = 0.03

#: Colours of walls and boundaries by what they do.
COLOURS = {
    "sticky": "#000000",
    "slip": "#009E73",
    "separable": "#CC79A7",
    "mirror": "#56B4E9",
    "mirror-sticky": "#0072B2",
    "prescribed": "#E69F00",
}


class Plane:
    """Two axes of a scene and what to do about the third: seen through, or cut at a place.

    `axes` are their numbers, `cut` a point (d,) in coordinates of the scene or None. Pictures are
    in the world: `origin` (d,) m is added to whatever is drawn.
    """

    def __init__(self, scene: SceneData, name: str, cut: Sequence[float] | None) -> None:
        """Take a name such as "xz"."""
        self.name = name
        self.axes = (AXES.index(name[0]), AXES.index(name[1]))
        self.cut = None if cut is None else np.asarray(cut, np.float64)
        self.origin = np.asarray(scene.origin, np.float64)
        self.lower = np.asarray(scene.lower, np.float64)
        self.upper = np.asarray(scene.upper, np.float64)
        self.hidden = next((a for a in range(scene.dimension) if a not in self.axes), None)

    def flat(self, points: Any) -> Array:
        """Return points (n, d) of the scene as (n, 2) m of the picture."""
        world = np.asarray(points, np.float64) + self.origin
        return np.asarray(world[:, list(self.axes)])

    def meets(self, lower: Any, upper: Any) -> bool:
        """Tell whether a box is in the picture: always, unless a cut passes beside it."""
        if self.cut is None or self.hidden is None:
            return True
        return bool(lower[self.hidden] <= self.cut[self.hidden] <= upper[self.hidden])


def sample_solid(
    solid: Any, lower: Array, upper: Array, most: int
) -> tuple[list[Array], Array] | None:
    """Return the places on each axis and the signed distance there, m, of the part in a domain.

    `most` is the number of places along the longest edge; None where nothing of it is inside.
    """
    low, high = (np.asarray(x, np.float64) for x in solid.bounds())
    low, high = np.maximum(low, lower), np.minimum(high, upper)
    if np.any(high <= low):
        return None
    # A rim, so that the outline closes inside the picture.
    rim = 1.5 * (high - low).max() / most
    low, high = low - rim, high + rim
    step = (high - low).max() / (most - 1)
    places = [
        np.linspace(a, b, max(4, int((b - a) / step) + 1)) for a, b in zip(low, high, strict=True)
    ]
    mesh = np.meshgrid(*places, indexing="ij")
    distance = solid.distance(np.stack([x.ravel() for x in mesh], axis=1))
    return places, np.asarray(distance).reshape(mesh[0].shape)


def _contour(axes: Any, plane: Plane, solid: Any, style: Mapping[str, Any], fill: bool) -> None:
    """Draw a solid by its distance: in 2D, where a plane cuts it, or its shadow."""
    a, b = plane.axes
    lower, upper = plane.lower.copy(), plane.upper.copy()
    if plane.hidden is None or plane.cut is None:
        found = sample_solid(solid, lower, upper, _IN_PLANE if plane.hidden is None else _IN_SPACE)
        if found is None:
            return
        places, distance = found
        if plane.hidden is not None:
            distance = distance.min(axis=plane.hidden)
    else:
        x, y = (np.linspace(lower[k], upper[k], _IN_PLANE) for k in (a, b))
        points = np.tile(plane.cut, (len(x) * len(y), 1))
        mesh = np.meshgrid(x, y, indexing="ij")
        points[:, a], points[:, b] = mesh[0].ravel(), mesh[1].ravel()
        distance = np.asarray(solid.distance(points)).reshape(mesh[0].shape)
        places = [x if k == a else y for k in range(3)]
    # Axes ascend in the samples; the picture may have them the other way round.
    turned = distance if a > b and (plane.hidden is None or plane.cut is None) else distance.T
    horizontal, vertical = (places[k] + plane.origin[k] for k in (a, b))
    if distance.min() >= 0:
        return
    if fill:
        axes.contourf(horizontal, vertical, turned, levels=[-np.inf, 0.0], colors=[STRUCTURE],
                      alpha=0.9)  # fmt: skip
    if distance.max() > 0:
        axes.contour(horizontal, vertical, turned, levels=[0.0], colors=[style["color"]],
                     linewidths=style["linewidth"], linestyles=style["linestyle"])  # fmt: skip


def draw_shape(
    axes: Any,
    plane: Plane,
    shape: Any,
    *,
    color: str,
    linewidth: float = 1.0,
    linestyle: str = "-",
    fill: bool = False,
) -> None:
    """Draw the outline of a shape; what has none in space, such as given particles, is left out."""
    style = {"color": color, "linewidth": linewidth, "linestyle": linestyle}
    patch: dict[str, Any] = {"edgecolor": color, "linewidth": linewidth, "linestyle": linestyle}
    patch |= {"zorder": 4, "facecolor": to_rgba(STRUCTURE, 0.9) if fill else "none"}
    if isinstance(shape, Box):
        if plane.meets(shape.lower, shape.upper):
            (low, high) = plane.flat([shape.lower, shape.upper])
            low, high = np.maximum(low, -1e9), np.minimum(high, 1e9)
            axes.add_patch(Rectangle(tuple(low), *(high - low), **patch))
    elif isinstance(shape, OrientedBox) and plane.hidden is None:
        corners = plane.flat(shape.corners)
        axes.add_patch(Polygon(corners[[0, 1, 3, 2]], closed=True, **patch))
    elif isinstance(shape, ElementMesh):
        lines = LineCollection(list(mesh_lines(shape, plane)), colors=color, linewidths=linewidth,
                               linestyles=linestyle, zorder=4)  # fmt: skip
        axes.add_collection(lines)
    elif isinstance(shape, Outline):
        for segment in np.asarray(shape.segments(), np.float64):
            ends = segment.reshape(2, 2) + plane.origin
            axes.plot(ends[:, 0], ends[:, 1], **style)
    elif hasattr(shape, "distance"):
        _contour(axes, plane, shape, style, fill)


def _kind(response: Any) -> str:
    return str(getattr(response, "kind", type(response).__name__.lower()))


def draw_domain(axes: Any, plane: Plane) -> None:
    """Draw the edge of the domain and set the limits of the picture."""
    (low, high) = plane.flat([plane.lower, plane.upper])
    axes.add_patch(Rectangle(tuple(low), *(high - low), facecolor="none", edgecolor="0.6",
                             linewidth=0.6, linestyle=":"))  # fmt: skip
    margin = MARGIN * (high - low).max()
    axes.set_xlim(low[0] - margin, high[0] + margin)
    axes.set_ylim(low[1] - margin, high[1] + margin)
    axes.set_aspect("equal")
    axes.set_xlabel(f"{plane.name[0]} [m]")
    axes.set_ylabel(f"{plane.name[1]} [m]")


def moves(boundary: Any) -> bool:
    """Tell whether the shape of a boundary goes from its place."""
    motion = getattr(boundary, "motion", None)
    return getattr(boundary, "rotation", None) is not None or (
        motion is not None and type(motion).__name__ in ("Displacement", "Travel")
    )


def draw_boundaries(
    axes: Any,
    plane: Plane,
    scene: SceneData,
    later: bool = False,
    fill: bool = True,
    kinds: bool = False,
) -> dict[str, str]:
    """Draw all boundaries; return label -> colour for a legend.

    `later`: the picture is not of the start, so that shapes that move are dashed where they began.
    `fill`: shapes are tinted, not only outlined. `kinds`: coloured by what they do, else grey.
    """
    legend: dict[str, str] = {}
    for boundary in scene.boundaries:
        response = boundary.response
        if isinstance(boundary.shape, DomainWalls):
            legend |= _draw_walls(axes, plane, scene, boundary, kinds)
            continue
        one = response if isinstance(response, Response) else next(iter(response.values()))
        colour = COLOURS.get(_kind(one), OUTLINE) if kinds else OUTLINE
        dashed = later and moves(boundary)
        draw_shape(axes, plane, boundary.shape, color=colour, linewidth=1.2,
                   fill=fill and not dashed,
                   linestyle="--" if dashed else "-")  # fmt: skip
        legend[f"{boundary.name}: {_kind(one)}{' (at 0 s)' if dashed else ''}"] = colour
    return legend


def _draw_walls(
    axes: Any, plane: Plane, scene: SceneData, boundary: Any, kinds: bool
) -> dict[str, str]:
    faces = faces_of(scene.dimension)
    if boundary.shape.faces != "all":
        faces = tuple(f for f in faces if f in boundary.shape.faces)
    legend = {}
    (low, high) = plane.flat([plane.lower, plane.upper])
    for face in faces:
        response = boundary.response
        one = response if isinstance(response, Response) else response.get(face)
        axis = AXES.index(face[0])
        if one is None or axis not in plane.axes:
            continue
        colour = COLOURS.get(_kind(one), OUTLINE) if kinds else OUTLINE
        legend[f"{boundary.name}: {_kind(one)}"] = colour
        across = plane.axes.index(axis)
        at = (low if face[1] == "-" else high)[across]
        ends = [low[1 - across], high[1 - across]]
        x, y = ([at, at], ends) if across == 0 else (ends, [at, at])
        width = 2.0 if kinds else 1.2
        axes.plot(x, y, color=colour, linewidth=width, zorder=5, solid_capstyle="projecting")
    return legend


def draw_flows(axes: Any, plane: Plane, scene: SceneData) -> dict[str, str]:
    """Draw the zones in which water comes in or goes out; return label -> colour."""
    legend = {}
    (low, high) = plane.flat([plane.lower, plane.upper])
    for placed in getattr(scene, "flows", ()):
        flow = placed.flow
        axis = AXES.index(flow.face[0])
        if axis not in plane.axes:
            continue
        colour = CYCLE[0] if type(flow).__name__ == "Inflow" else CYCLE[1]
        across = plane.axes.index(axis)
        corner, size = low.copy(), high - low
        size[across] = flow.zone * scene.cell_size
        if flow.face[1] == "+":
            corner[across] = high[across] - size[across]
        style: dict[str, Any] = {"linewidth": 0.8, "hatch": "//", "zorder": 1}
        style |= {"facecolor": to_rgba(colour, 0.12), "edgecolor": colour}
        axes.add_patch(Rectangle(tuple(corner), *size, **style))
        legend[f"{placed.name}: {type(flow).__name__.lower()}"] = colour
    return legend
