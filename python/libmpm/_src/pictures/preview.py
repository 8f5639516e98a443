"""`Scene.preview`: a scene before it runs, with its particles, boundaries and sensors."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.colors import Normalize, to_rgba
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from libmpm._src.base.axes import AXES
from libmpm._src.base.values import shown, warned_already
from libmpm._src.errors import Error, SceneError
from libmpm._src.pictures import figures as common
from libmpm._src.pictures.instruments import legend_of_sensors
from libmpm._src.pictures.outlines import draw_flows, draw_shape
from libmpm._src.pictures.panel import Dots, Panel, body_colours, height_of, legend_of, width_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pyvista import Plotter

    from libmpm._src.scene.data import SceneData

__all__ = ["preview", "sampled_bodies", "vertical_of"]

#: Widths of pictures of one plane after another, and of three views, inches.
_WIDTH, _WIDE = 8.0, 11.0
#: Rows that are asked for at a time of bodies of which few are drawn.
_CHUNK = 1 << 20


def vertical_of(scene: SceneData) -> int:
    """Return the axis along which gravity pulls most at the start; the last without gravity."""
    from libmpm._src.scene.places import initial_gravity

    strength = np.abs(initial_gravity(scene))
    return int(np.argmax(strength)) if strength.any() else scene.dimension - 1


def sampled_bodies(scene: SceneData, most: int) -> tuple[dict[str, Dots], int, str]:
    """Return the particles to draw of each body, in the world, and how many there are.

    The third is what forbids the scene to run, in which case there are none; empty otherwise.
    """
    from libmpm._src.run.engine_spec import lower

    try:
        with warned_already():
            bodies = lower(scene, precision="double")["bodies"]
    except SceneError as error:
        common.shares([], most)
        return {}, 0, error.problems[0]
    offset = np.asarray(scene.origin, np.float64) + np.asarray(scene.lower, np.float64)
    counts = [int(b["count"]) for b in bodies]
    found = {}
    for body, count, share in zip(bodies, counts, common.shares(counts, most), strict=True):
        rows = body["position"]
        if isinstance(rows, np.ndarray):
            all_rows = rows
            rows = lambda a, b, all_rows=all_rows: all_rows[a:b]  # noqa: E731
        wanted = common.chosen(count, share)
        parts = [np.empty((0, scene.dimension))]
        for first in range(0, count, _CHUNK):
            last = min(first + _CHUNK, count)
            here = wanted[(wanted >= first) & (wanted < last)]
            if len(here):
                parts.append(np.asarray(rows(first, last))[here - first])
        drawn = len(wanted) / max(count, 1)
        found[body["name"]] = Dots(np.concatenate(parts) + offset, None, drawn)
    return found, sum(counts), ""


def preview(
    scene: SceneData,
    *,
    backend: str = "matplotlib",
    planes: Sequence[str] | str | None = None,
    cut: Sequence[float] | None = None,
    most: int = common.MOST,
) -> Figure | Plotter:
    """See `Scene.preview`."""
    if not isinstance(backend, str):
        raise Error(f"backend is {shown(backend)}; expected 'matplotlib' or 'pyvista'")
    if backend == "pyvista":
        from libmpm._src.pictures.view_3d import preview_in_space

        return preview_in_space(scene, most=most)
    if backend != "matplotlib":
        raise Error(f"backend is {shown(backend)}; expected 'matplotlib' or 'pyvista'")
    for body in scene.bodies:
        if (d := getattr(body.shape, "dimension", scene.dimension)) != scene.dimension:
            raise SceneError(f"body '{body.name}': its shape is {d}D; expected {scene.dimension}D")
    vertical = vertical_of(scene)
    d = scene.dimension
    three = planes is None and d == 3
    if three:
        flat = [a for a in range(3) if a != vertical]
        names = [AXES[a] + AXES[vertical] for a in flat]
        planes = [*names, AXES[flat[0]] + AXES[flat[1]]]
    planes = common.planes_of(d, planes, vertical)
    cut = common.check_cut(d, cut)
    particles, count, problem = sampled_bodies(scene, most)
    picture, places = _three_views(scene, vertical) if three else _rows(scene, planes)
    drawn = sum(map(len, particles.values()))
    colours = body_colours(scene)
    boundaries: dict[str, str] = {}
    flows: dict[str, str] = {}
    for place, name in zip(places, planes, strict=True):
        panel = Panel(
            picture.add_subplot(place), scene, name, vertical,
            bodies=list(particles), norm=Normalize(), cut=cut, kinds=True,
        )  # fmt: skip
        panel.show(particles)
        boundaries |= panel.legend
        plane = panel.plane
        if plane is None:
            continue
        flows |= draw_flows(panel.axes, plane, scene)
        for body in scene.bodies:
            draw_shape(panel.axes, plane, body.shape, color=colours[body.name], linewidth=0.6)
        if panel.place:
            panel.axes.set_title(panel.place, fontsize=9)
    handles, texts = legend_of(colours)
    handles += [Line2D([], [], color=c, linewidth=2.0) for c in boundaries.values()]
    handles += [Patch(facecolor=to_rgba(c, 0.12), edgecolor=c, hatch="//") for c in flows.values()]
    texts += [*boundaries, *flows]
    for more, into in zip(legend_of_sensors(scene), (handles, texts), strict=True):
        into += more
    common.legend_below(picture, handles, texts)
    said = [scene.name or "scene", f"{count:,} particles" if not problem else "cannot run yet",
            common.note(drawn, count)]  # fmt: skip
    title = common.title_of(picture, said, 10)
    if problem:
        title += "\n" + textwrap.fill(problem, int(11 * picture.get_figwidth()), max_lines=6)
    picture.suptitle(title, fontsize=10)
    return picture


def _rows(scene: SceneData, planes: Sequence[str]) -> tuple[common.Picture, list[Any]]:
    """Return a figure with a row for each plane, and the places of its panels."""
    width = width_of(scene, planes, _WIDTH)
    heights = [height_of(scene, name, width) for name in planes]
    picture = common.Picture(figsize=(width, sum(heights) + 0.7), layout="constrained")
    grid = picture.add_gridspec(len(planes), 1, height_ratios=heights)
    return picture, [grid[k] for k in range(len(planes))]


def _three_views(scene: SceneData, vertical: int) -> tuple[common.Picture, list[Any]]:
    """Return a figure with room for two elevations and a plan, at one scale where they fit.

    The second elevation stands beside the first, the plan below it. A panel has an inch at least.
    """
    size = np.asarray(scene.upper, np.float64) - np.asarray(scene.lower, np.float64)
    along, across = (size[a] for a in range(3) if a != vertical)
    scale = min((_WIDE - 1.6) / (along + across), 7.0 / (size[vertical] + across))
    wide = np.maximum(scale * np.array([along, across]), 1.8)
    tall = np.maximum(scale * np.array([size[vertical], across]), 1.0)
    figsize = (float(wide.sum()) + 1.6, float(tall.sum()) + 2.2)
    picture = common.Picture(figsize=figsize, layout="constrained")
    grid = picture.add_gridspec(2, 2, width_ratios=wide, height_ratios=tall)
    return picture, [grid[0, 0], grid[0, 1], grid[1, 0]]
