"""`Scene.preview`: a scene before it runs, with its particles, boundaries and sensors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.colors import Normalize
from matplotlib.lines import Line2D

from libmpm._src.base.axes import AXES
from libmpm._src.base.values import shown, warned_already
from libmpm._src.errors import Error, SceneError
from libmpm._src.pictures import figures as common
from libmpm._src.pictures.outlines import draw_flows, draw_shape
from libmpm._src.pictures.panel import Dots, Panel, body_colours

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pyvista import Plotter

    from libmpm._src.scene.data import SceneData

__all__ = ["preview", "sampled_bodies", "vertical_of"]

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
    if backend == "pyvista":
        from libmpm._src.pictures.view_3d import preview_in_space

        return preview_in_space(scene, most=most)
    if backend != "matplotlib":
        raise Error(f"backend is {shown(backend)}; expected 'matplotlib' or 'pyvista'")
    vertical = vertical_of(scene)
    d = scene.dimension
    if planes is None and d == 3:
        flat = [a for a in range(3) if a != vertical]
        names = [AXES[a] + AXES[vertical] for a in flat]
        planes = [*names, AXES[flat[0]] + AXES[flat[1]]]
    planes = common.planes_of(d, planes, vertical)
    cut = common.check_cut(d, cut)
    particles, count, problem = sampled_bodies(scene, most)
    wide = 1 if len(planes) == 1 else 2
    tall = -(-len(planes) // wide)
    picture = common.Picture(figsize=(6.5 * wide, 4.0 * tall), layout="constrained")
    drawn = sum(map(len, particles.values()))
    legend: dict[str, str] = {}
    for k, name in enumerate(planes):
        panel = Panel(
            picture.add_subplot(tall, wide, k + 1), scene, name, vertical,
            bodies=list(particles), norm=Normalize(), cut=cut,
        )  # fmt: skip
        panel.show(particles)
        legend |= body_colours(scene) | panel.legend
        plane = panel.plane
        if plane is None:
            continue
        legend |= draw_flows(panel.axes, plane, scene)
        for body in scene.bodies:
            draw_shape(panel.axes, plane, body.shape, color=legend[body.name], linewidth=0.6)
        if plane.cut is not None and plane.hidden is not None:
            at = plane.cut[plane.hidden] + plane.origin[plane.hidden]
            panel.axes.set_title(f"cut at {AXES[plane.hidden]} = {at:g} m", fontsize=9)
    lines = [Line2D([], [], color=colour, linewidth=3) for colour in legend.values()]
    if lines:
        show: Any = picture.legend
        show(lines, list(legend), loc="outside lower center", fontsize=7, ncols=4)
    said = [scene.name or "scene", f"{count:,} particles" if not problem else "cannot run yet",
            common.note(drawn, count)]  # fmt: skip
    picture.suptitle(", ".join(x for x in said if x) + (f"\n{problem[:160]}" if problem else ""),
                     fontsize=10)  # fmt: skip
    return picture
