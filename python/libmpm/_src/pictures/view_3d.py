"""`Simulation.view`: views in space by pyvista, in a window or in a notebook."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from libmpm._src.base import palette
from libmpm._src.base.optional_packages import need
from libmpm._src.errors import Error
from libmpm._src.pictures import figures as common
from libmpm._src.pictures.instruments import load_cell_edges, sensor_points
from libmpm._src.pictures.outlines import COLOURS, moves, sample_solid
from libmpm._src.pictures.panel import COLOUR_MAP, body_colours, radius_of
from libmpm._src.pictures.plot import extend_of, sampled_particles
from libmpm._src.pictures.preview import sampled_bodies, vertical_of
from libmpm._src.sensors.engine_sensors import LoadCell
from libmpm._src.shapes.boxes import Box, DomainWalls
from libmpm._src.shapes.element_mesh import ElementMesh

if TYPE_CHECKING:
    from pyvista import Plotter

    from libmpm._src.run.running import Running
    from libmpm._src.scene.data import SceneData

__all__ = ["preview_in_space", "view"]

#: Places along the longest edge of a solid at which its distance is looked at.
_PLACES = 72
#: The colour bar: upright, so that its title stands above its numbers.
_BAR = {"vertical": True, "title_font_size": 16, "label_font_size": 14, "position_x": 0.87,
        "position_y": 0.2, "height": 0.6, "n_labels": 5}  # fmt: skip


def _plotter(scene: SceneData, what: str, off_screen: bool | None) -> tuple[Any, Any]:
    if scene.dimension != 3:
        raise Error(f"{what}: the scene has {scene.dimension} dimensions; expected 3; use the "
                    "matplotlib picture, Scene.preview() or Simulation.plot()")  # fmt: skip
    pyvista = need("pyvista", what, "viz")
    return pyvista, pyvista.Plotter(off_screen=off_screen)


def surface_of(pyvista: Any, scene: SceneData, shape: Any) -> Any:
    """Return a shape of the scene as a surface in the world; None of what has none."""
    origin = np.asarray(scene.origin, np.float64)
    lower, upper = np.asarray(scene.lower, np.float64), np.asarray(scene.upper, np.float64)
    if isinstance(shape, Box):
        low, high = np.asarray(shape.lower) + origin, np.asarray(shape.upper) + origin
        return pyvista.Box(np.stack([low, high], axis=1).ravel())
    if isinstance(shape, ElementMesh):
        corners = np.insert(shape.surface, 0, 3, axis=1)
        return pyvista.PolyData(shape.vertices + origin, faces=corners.ravel())
    if not hasattr(shape, "distance"):
        return None
    found = sample_solid(shape, lower, upper, _PLACES)
    if found is None:
        return None
    places, distance = found
    if distance.min() >= 0 or distance.max() <= 0:
        return None
    grid = pyvista.RectilinearGrid(*(p + o for p, o in zip(places, origin, strict=True)))
    grid["distance"] = distance.ravel(order="F")
    return grid.contour([0.0], scalars="distance")


def _surroundings(
    pyvista: Any, plotter: Any, scene: SceneData, *, later: bool, kinds: bool
) -> None:
    """Add the domain, the boundaries (`kinds`: coloured by what they do) and the sensors."""
    origin = np.asarray(scene.origin, np.float64)
    low, high = np.asarray(scene.lower) + origin, np.asarray(scene.upper) + origin
    domain = pyvista.Box(np.stack([low, high], axis=1).ravel())
    plotter.add_mesh(domain, style="wireframe", color="grey", line_width=1, name="domain")
    for boundary in scene.boundaries:
        if isinstance(boundary.shape, DomainWalls):
            continue
        surface = surface_of(pyvista, scene, boundary.shape)
        if surface is None or surface.n_points == 0:
            continue
        response = boundary.response
        kind = getattr(response, "kind", "") or "several"
        style = {"style": "wireframe"} if later and moves(boundary) else {}
        colour = COLOURS.get(kind, palette.STRUCTURE) if kinds else palette.STRUCTURE
        plotter.add_mesh(surface, color=colour, name=f"boundary {boundary.name}", **style)
    _sensors(pyvista, plotter, scene)
    plotter.show_axes()
    vertical = vertical_of(scene)
    if vertical == 2:
        plotter.camera_position = "iso"
    else:
        plotter.camera_position = "xy" if vertical == 1 else "yz"


def _sensors(pyvista: Any, plotter: Any, scene: SceneData) -> None:
    """Add load cells as edges, gauges as lines, and the names of all sensors that have a place."""
    origin = np.asarray(scene.origin, np.float64)
    vertical = vertical_of(scene)
    named: dict[str, np.ndarray[Any, Any]] = {}
    for placed in scene.sensors:
        if not isinstance(placed.sensor, LoadCell):
            continue
        edges = load_cell_edges(scene, placed.sensor)
        if edges:
            ends = np.concatenate(edges)
            plotter.add_lines(ends, color=palette.LOAD_CELL, width=3, name=f"sensor {placed.name}")
            named[placed.name] = ends[np.argmax(ends[:, vertical])]
    for name, (place, gauge) in sensor_points(scene, vertical).items():
        point = place + origin
        if gauge:
            top = point.copy()
            top[vertical] = scene.upper[vertical] + origin[vertical]
            plotter.add_lines(np.stack([point, top]), color=palette.SENSOR, width=1,
                              name=f"sensor {name}")  # fmt: skip
            point = top
        named[name] = point
    if named:
        plotter.add_point_labels(np.stack(list(named.values())), list(named), font_size=12,
                                 point_size=8, name="sensors", always_visible=True)  # fmt: skip


def _add_balls(plotter: Any, points: Any, radius: float, **style: Any) -> None:
    """Add particles as lit balls of a radius in the world, m."""
    actor = plotter.add_points(points, style="points_gaussian", emissive=False,
                               render_points_as_spheres=True, **style)  # fmt: skip
    actor.mapper.scale_factor = radius


def preview_in_space(scene: SceneData, *, most: int, off_screen: bool | None = None) -> Plotter:
    """Return a plotter with the particles, boundaries and sensors of a scene."""
    pyvista, plotter = _plotter(scene, "Scene.preview(backend='pyvista')", off_screen)
    particles, count, problem = sampled_bodies(scene, most)
    colours = body_colours(scene)
    for name, dots in particles.items():
        if len(dots):
            _add_balls(plotter, dots.position, radius_of(scene, name, dots.share),
                       color=colours[name], label=name, name=f"body {name}")  # fmt: skip
    if problem:
        for body in scene.bodies:
            surface = surface_of(pyvista, scene, body.shape)
            if surface is not None and surface.n_points:
                plotter.add_mesh(surface, style="wireframe", color=colours[body.name],
                                 label=body.name, name=f"body {body.name}")  # fmt: skip
    _surroundings(pyvista, plotter, scene, later=False, kinds=True)
    drawn = sum(map(len, particles.values()))
    said = [scene.name, f"{count:,} particles" if not problem else problem[:100],
            common.note(drawn, count)]  # fmt: skip
    plotter.add_text(", ".join(x for x in said if x), font_size=9, name="title")
    if scene.bodies and (particles or problem):
        plotter.add_legend(face="circle", bcolor=None, size=(0.1, 0.1))
    return cast("Plotter", plotter)


def view(
    simulation: Running,
    *,
    colour: str | None = "speed",
    bodies: Sequence[str] | str | None = None,
    limits: tuple[float, float] | None = None,
    most: int = common.MOST,
    off_screen: bool | None = None,
) -> Plotter:
    """See `Simulation.view`."""
    scene = simulation.scene
    pyvista, plotter = _plotter(scene, "Simulation.view", off_screen)
    dots, count = sampled_particles(simulation, colour, bodies, most)
    coloured = [d.colour for d in dots.values() if d.colour is not None]
    low, high = common.limits_of(coloured) if limits is None else common.check_limits(limits)
    colours = body_colours(scene)
    for name, body in dots.items():
        if not len(body):
            continue
        cloud = pyvista.PolyData(np.ascontiguousarray(body.position))
        size = radius_of(scene, name, body.share)
        if body.colour is None or colour is None:
            _add_balls(plotter, cloud, size, color=colours[name], name=f"body {name}")
            continue
        label = common.label_of(colour)
        cloud[label] = body.colour
        _add_balls(plotter, cloud, size, scalars=label, clim=(low, high), cmap=COLOUR_MAP,
                   name=f"body {name}", scalar_bar_args=_BAR | {"title": f"{label}\n"})  # fmt: skip
    _surroundings(pyvista, plotter, scene, later=simulation.time > 0, kinds=False)
    drawn = sum(map(len, dots.values()))
    beyond = (
        ""
        if extend_of(coloured, low, high) == "neither"
        else "colour range is clipped to the limits"
    )
    said = [scene.name, f"{simulation.time:.4g} s", common.note(drawn, count), beyond]
    plotter.add_text(", ".join(x for x in said if x), font_size=9, name="title")
    return cast("Plotter", plotter)
