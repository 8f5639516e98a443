"""Load cells, gauges and probes in pictures, where they measure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from libmpm._src.base.axes import AXES
from libmpm._src.base.palette import LOAD_CELL, SENSOR
from libmpm._src.pictures.directions import View
from libmpm._src.pictures.outlines import Plane, draw_shape
from libmpm._src.sensors.engine_sensors import LoadCell
from libmpm._src.shapes.boxes import Box, DomainWalls, faces_of

if TYPE_CHECKING:
    from libmpm._src.scene.data import SceneData

__all__ = [
    "draw_sensors",
    "draw_sensors_in_space",
    "legend_of_sensors",
    "load_cell_edges",
    "measured_bounds",
    "sensor_points",
]

Array = NDArray[np.float64]


def legend_of_sensors(scene: SceneData) -> tuple[list[Any], list[str]]:
    """Return handles and texts of a legend of the kinds of sensors that a scene draws."""
    found: dict[str, Any] = {}
    for placed in scene.sensors:
        sensor = placed.sensor
        position = getattr(sensor, "position", None)
        if isinstance(sensor, LoadCell):
            found.setdefault("load cell", Line2D([], [], color=LOAD_CELL, linewidth=2.2))
        elif position is not None and np.ndim(position) == 1:
            if len(position) == scene.dimension - 1:
                line = Line2D([], [], color=SENSOR, linewidth=0.8, linestyle="-.")
                found.setdefault("gauge", line)
            else:
                mark = Line2D([], [], color=SENSOR, linewidth=0, marker="x", markersize=5)
                found.setdefault("probe", mark)
    return list(found.values()), list(found)


def _draw_load_cell(axes: Any, plane: Plane, scene: SceneData, name: str, cell: LoadCell) -> None:
    """Draw the faces that a load cell measures as thick lines."""
    boundary = next((b for b in scene.boundaries if b.name == cell.boundary), None)
    if boundary is None:
        return
    shape = boundary.shape
    style: dict[str, Any] = {"color": LOAD_CELL, "linewidth": 2.2, "zorder": 6}
    if not isinstance(shape, Box | DomainWalls):
        draw_shape(axes, plane, shape, color=LOAD_CELL, linewidth=2.2)
    low, high = _bounds(scene, shape)
    if not plane.meets(low, high):
        return
    (a, b) = plane.flat([low, high])
    if isinstance(shape, Box | DomainWalls):
        for face in _measured(scene, shape, cell):
            axis = AXES.index(face[0])
            if axis not in plane.axes:
                continue
            across = plane.axes.index(axis)
            at, ends = (a if face[1] == "-" else b)[across], [a[1 - across], b[1 - across]]
            axes.plot(*(([at, at], ends) if across == 0 else (ends, [at, at])), **style)
    axes.annotate(name, (a[0], b[1]), fontsize=7, zorder=7, color=LOAD_CELL, va="bottom",
                  xytext=(0, 2), textcoords="offset points")  # fmt: skip


def _bounds(scene: SceneData, shape: Any) -> tuple[Array, Array]:
    """Return the box around what a load cell measures, in coordinates of the scene."""
    lower, upper = np.asarray(scene.lower, np.float64), np.asarray(scene.upper, np.float64)
    low, high = lower, upper
    if isinstance(shape, Box):
        low, high = np.asarray(shape.lower, np.float64), np.asarray(shape.upper, np.float64)
    elif not isinstance(shape, DomainWalls) and hasattr(shape, "bounds"):
        low, high = (np.asarray(x, np.float64) for x in shape.bounds())
    return np.maximum(low, lower), np.minimum(high, upper)


def measured_bounds(scene: SceneData, cell: LoadCell) -> tuple[Array, Array]:
    """Return the box around what a load cell measures, in coordinates of the scene; the domain
    where its boundary is not there.
    """
    boundary = next((b for b in scene.boundaries if b.name == cell.boundary), None)
    return _bounds(scene, None if boundary is None else boundary.shape)


def _measured(scene: SceneData, shape: Any, cell: LoadCell) -> tuple[str, ...]:
    """Return the faces that a load cell measures."""
    known = faces_of(scene.dimension)
    if isinstance(shape, DomainWalls) and shape.faces != "all":
        known = tuple(f for f in known if f in shape.faces)
    return known if cell.faces == "all" else tuple(cell.faces)


def load_cell_edges(scene: SceneData, cell: LoadCell) -> list[Array]:
    """Return the edges (2, 3) m, in the world, of the faces that a load cell in space measures.

    Of shapes that are no boxes, those of the box around them.
    """
    boundary = next((b for b in scene.boundaries if b.name == cell.boundary), None)
    if boundary is None:
        return []
    shape = boundary.shape
    ends = np.stack(_bounds(scene, shape)) + np.asarray(scene.origin, np.float64)
    plain = isinstance(shape, Box | DomainWalls)
    faces = _measured(scene, shape, cell) if plain else faces_of(3)
    edges: dict[tuple[float, ...], Array] = {}
    for face in faces:
        axis = AXES.index(face[0])
        others = [a for a in range(3) if a != axis]
        corner = np.empty((4, 3))
        corner[:, axis] = ends[int(face[1] == "+"), axis]
        for k, (i, j) in enumerate(((0, 0), (1, 0), (1, 1), (0, 1))):
            corner[k, others] = ends[i, others[0]], ends[j, others[1]]
        for k in range(4):
            edge = corner[[k, (k + 1) % 4]]
            edges[tuple(np.sort(edge, axis=0).ravel())] = edge
    return list(edges.values())


def sensor_points(scene: SceneData, vertical: int) -> dict[str, tuple[Array, bool]]:
    """Return the place (d,) m of each sensor that has one, in coordinates of the scene.

    The second says whether it is a gauge, which measures a vertical: its place is on the floor.
    """
    found = {}
    for placed in scene.sensors:
        position = getattr(placed.sensor, "position", None)
        if position is None or np.ndim(position) != 1:
            continue
        point = np.asarray(position, np.float64)
        gauge = len(point) == scene.dimension - 1
        if gauge:
            point = np.insert(point, vertical, scene.lower[vertical])
        found[placed.name] = point, gauge
    return found


def draw_sensors(axes: Any, plane: Plane, scene: SceneData, vertical: int) -> None:
    """Mark the sensors that have a place in a plane."""
    (low, high) = plane.flat([plane.lower, plane.upper])
    points = sensor_points(scene, vertical)
    for placed in scene.sensors:
        sensor = placed.sensor
        if isinstance(sensor, LoadCell):
            _draw_load_cell(axes, plane, scene, placed.name, sensor)
            continue
        region = next(
            (s for name in ("region", "within", "shape", "box")
             if hasattr(s := getattr(sensor, name, None), "bounds") or isinstance(s, Box)),
            None,
        )  # fmt: skip
        if region is not None:
            draw_shape(axes, plane, region, color=SENSOR, linewidth=0.8, linestyle=":")
            where = plane.flat([region.bounds()[0]])[0]
        elif placed.name in points:
            point, gauge = points[placed.name]
            where = plane.flat([point])[0]
            if gauge and vertical in plane.axes:
                across = 1 - plane.axes.index(vertical)
                line = axes.axvline if across == 0 else axes.axhline
                line(where[across], color=SENSOR, linewidth=0.8, linestyle="-.", zorder=6)
                where[1 - across] = high[1 - across]
            else:
                mark = "^" if gauge else "x"
                axes.plot(*where, mark, color=SENSOR, markersize=5, zorder=6)
        else:
            continue
        where = np.clip(where, low, high)
        # In the last third to the left, so that long names end within the panel.
        side = "left" if where[0] <= low[0] + 2.0 / 3.0 * (high[0] - low[0]) else "right"
        axes.annotate(placed.name, where, fontsize=7, zorder=7, ha=side,
                      xytext=(2 if side == "left" else -2, 2),
                      textcoords="offset points")  # fmt: skip


def draw_sensors_in_space(axes: Any, view: View, scene: SceneData, vertical: int) -> None:
    """Mark load cells, gauges and probes in a view from above a corner, in front of all else."""
    origin = np.asarray(scene.origin, np.float64)

    def name(text: str, point: Array, colour: str) -> None:
        axes.annotate(text, view.project(point[None])[0][0], fontsize=7, zorder=7, color=colour,
                      va="bottom", xytext=(2, 2), textcoords="offset points")  # fmt: skip

    for placed in scene.sensors:
        if not isinstance(placed.sensor, LoadCell):
            continue
        edges = load_cell_edges(scene, placed.sensor)
        for edge in edges:
            axes.plot(*view.project(edge)[0].T, color=LOAD_CELL, linewidth=1.4, zorder=6)
        if edges:
            corners = np.concatenate(edges)
            name(placed.name, corners[np.argmax(view.project(corners)[0][:, 1])], LOAD_CELL)
    for text, (place, gauge) in sensor_points(scene, vertical).items():
        point = place + origin
        if gauge:
            top = point.copy()
            top[vertical] = scene.upper[vertical] + origin[vertical]
            ends = view.project(np.stack([point, top]))[0]
            axes.plot(*ends.T, color=SENSOR, linewidth=0.8, linestyle="-.", zorder=6)
            point = top
        else:
            axes.plot(*view.project(point[None])[0][0], "x", color=SENSOR, markersize=5, zorder=6)
        name(text, point, SENSOR)
