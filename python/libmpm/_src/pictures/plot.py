"""`Simulation.plot`: particles of a moment, coloured by an attribute."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.colors import Normalize
from numpy.typing import NDArray

from libmpm._src.base.values import nearest, shown
from libmpm._src.errors import Error
from libmpm._src.pictures import figures as common
from libmpm._src.pictures.instruments import legend_of_sensors
from libmpm._src.pictures.panel import (
    Dots,
    Panel,
    height_of,
    is_fluid,
    legend_of,
    middle_of,
    width_of,
)
from libmpm._src.pictures.preview import vertical_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from libmpm._src.run.running import Particles, Running
    from libmpm._src.scene.data import SceneData

__all__ = ["LEGEND", "bodies_of", "chosen_colour", "extend_of", "plot", "sampled_particles"]

Array = NDArray[np.float64]

#: Width of a picture, inches.
_WIDTH = 8.0
#: Height of a legend below the panels, inches.
LEGEND = 0.4


def bodies_of(scene: SceneData, bodies: Sequence[str] | str | None) -> list[str]:
    """Return the names of the bodies to draw; raises `Error` for unknown ones."""
    known = [b.name for b in scene.bodies]
    if bodies is None:
        return known
    wanted = common.names_of("bodies", bodies)
    for name in wanted:
        if name not in known:
            raise Error(f"bodies has '{name}', which is no body; {nearest(name, known)}")
    return wanted


def _source(view: Particles, colour: str | None) -> str | None:
    """Return the attribute of a body that holds a colour: that of the name, or of its component."""
    if colour is None:
        return None
    if not isinstance(colour, str):
        raise Error(f"colour is {shown(colour)}; expected the name of an attribute, or None")
    candidates = (colour, common.split_name(colour)[0])
    return next((name for name in candidates if view.refusal(name) is None), None)


def sampled_particles(
    simulation: Running, colour: str | None, bodies: Sequence[str] | str | None, most: int
) -> tuple[dict[str, Dots], int]:
    """Return the dots of each body and the number of particles that they stand for."""
    names = bodies_of(simulation.scene, bodies)
    views = {name: simulation.particles[name] for name in names}
    sources = {name: _source(view, colour) for name, view in views.items()}
    if colour is not None and not any(sources.values()):
        first = next(iter(views.values()))
        why = first.refusal(colour) or nearest(colour, first.names)
        raise Error(f"colour is {shown(colour)}, which no body drawn has; {why}")
    coloured = chosen_colour(simulation.scene, names, colour, bodies)
    counts = [len(views[name]) for name in names]
    dots = {}
    for name, count, share in zip(names, counts, common.shares(counts, most), strict=True):
        here = sources[name] if name in coloured else None
        arrays = views[name].read(["position", *([here] if here else [])])
        rows = common.chosen(count, share)
        numbers = None
        if here is not None and colour is not None:
            picked = {here: np.asarray(arrays[here])[rows]}
            numbers = (
                np.asarray(picked[here], float)
                if picked[here].ndim == 1
                else common.colours_of(picked, colour)
            )
        dots[name] = Dots(arrays["position"][rows], numbers, len(rows) / max(count, 1))
    return dots, sum(counts)


def chosen_colour(
    scene: SceneData, names: Sequence[str], colour: str | None, bodies: Sequence[str] | str | None
) -> set[str]:
    """Return the bodies that an attribute colours.

    Of fluids and solids together the speed, which says little of debris, is that of the fluids;
    who names the bodies means all of them.
    """
    fluids = {name for name in names if is_fluid(scene, name)}
    if colour == "speed" and bodies is None and fluids:
        return fluids
    return set(names)


def extend_of(values: Sequence[Array], low: float, high: float) -> str:
    """Return at which ends of a colour bar there are values beyond it."""
    finite = [v[np.isfinite(v)] for v in values]
    under = any(bool(np.any(v < low)) for v in finite)
    over = any(bool(np.any(v > high)) for v in finite)
    return {(0, 0): "neither", (1, 0): "min", (0, 1): "max", (1, 1): "both"}[int(under), int(over)]


def plot(
    simulation: Running,
    *,
    colour: str | None = "speed",
    bodies: Sequence[str] | str | None = None,
    planes: Sequence[str] | str | None = None,
    cut: Sequence[float] | None = None,
    limits: tuple[float, float] | None = None,
    most: int = common.MOST,
    axes: Any = None,
) -> Figure:
    """See `Simulation.plot`."""
    scene = simulation.scene
    vertical = vertical_of(scene)
    names = common.planes_of(scene.dimension, planes, vertical)
    cut = common.check_cut(scene.dimension, cut)
    common.check_axes(axes)
    cuts = [cut] * len(names)
    if planes is None and cut is None and scene.dimension == 3:
        cuts[0] = middle_of(scene)  # from outside, the nearest water would hide what it meets
    if axes is not None and len(names) > 1:
        names = names[:1]
    dots, count = sampled_particles(simulation, colour, bodies, most)
    coloured = [d.colour for d in dots.values() if d.colour is not None]
    low, high = common.limits_of(coloured) if limits is None else common.check_limits(limits)
    picture = axes.figure if axes is not None else None
    if picture is None:
        width = width_of(scene, names, _WIDTH)
        heights = [height_of(scene, name, width) for name in names]
        picture = common.Picture(figsize=(width, sum(heights) + LEGEND), layout="constrained")
        grid = picture.add_gridspec(len(names), 1, height_ratios=heights)
    image = None
    panels = []
    for k, name in enumerate(names):
        panel = Panel(
            axes if axes is not None else picture.add_subplot(grid[k]),
            scene, name, vertical, bodies=list(dots), norm=Normalize(low, high),
            later=simulation.time > 0, cut=cuts[k],
        )  # fmt: skip
        image = panel.show(dots) or image
        panels.append(panel)
    if image is not None and colour is not None:
        picture.colorbar(image, ax=[p.axes for p in panels], label=common.label_of(colour),
                         shrink=0.85, extend=extend_of(coloured, low, high))  # fmt: skip
    drawn = sum(map(len, dots.values()))
    plain = panels[0].plain(dots) if len(dots) > 1 else {}
    handles, texts = (
        a + b for a, b in zip(legend_of(plain), legend_of_sensors(scene), strict=True)
    )
    if axes is None:
        common.legend_below(picture, handles, texts)
    elif handles:
        axes.legend(handles, texts, fontsize=8, framealpha=0.8)
    said = [scene.name, f"{simulation.time:.4g} s", common.note(drawn, count), panels[0].place]
    title = common.title_of(picture, said, 10)
    panels[0].axes.set_title(title, fontsize=10, loc="left")
    for panel in panels[1:]:
        panel.axes.set_title(panel.place, fontsize=10, loc="left")
    return picture
