"""Particles of a moment as dots, coloured by an attribute."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.colors import Normalize
from numpy.typing import NDArray

from libmpm._src.errors import Error
from libmpm._src.pictures import figure as common
from libmpm._src.pictures.outlines import Plane, draw_boundaries, draw_domain
from libmpm._src.pictures.preview import vertical_of
from libmpm._src.values import nearest

if TYPE_CHECKING:
    from libmpm._src.scene import Scene
    from libmpm._src.simulation import Simulation
    from libmpm._src.views import BodyView

__all__ = ["Dots", "dot_size", "draw_dots", "plot", "sampled_particles"]

Array = NDArray[np.float64]

#: Colour map of all pictures, and the colour of bodies without the attribute.
COLOUR_MAP, PLAIN = "viridis", "0.55"


class Dots:
    """What is drawn of one body: `position` (n, d) m in the world, and `colour` (n,) or None."""

    def __init__(self, position: Array, colour: Array | None) -> None:
        """Take both."""
        self.position = position
        self.colour = colour

    def __len__(self) -> int:
        """Return the number of dots."""
        return len(self.position)


def dot_size(drawn: int) -> float:
    """Return the area of a dot in points²: large enough to see few, small enough for many."""
    return float(np.clip(2e4 / max(drawn, 1), 0.4, 12.0))


def bodies_of(scene: Scene, bodies: Sequence[str] | str | None) -> list[str]:
    """Return the names of the bodies to draw; raises `Error` for unknown ones."""
    known = [b.name for b in scene.bodies]
    if bodies is None:
        return known
    wanted = [bodies] if isinstance(bodies, str) else list(bodies)
    for name in wanted:
        if name not in known:
            raise Error(f"bodies has '{name}', which is no body; {nearest(name, known)}")
    return wanted


def _source(view: BodyView, color: str | None) -> str | None:
    """Return the attribute of a body that holds a colour: that of the name, or of its component."""
    if color is None:
        return None
    candidates = (color, common.split_name(color)[0])
    return next((name for name in candidates if view.refusal(name) is None), None)


def sampled_particles(
    simulation: Simulation, color: str | None, bodies: Sequence[str] | str | None, most: int
) -> tuple[dict[str, Dots], int]:
    """Return the dots of each body and the number of particles that they stand for."""
    names = bodies_of(simulation.scene, bodies)
    views = {name: simulation.particles[name] for name in names}
    sources = {name: _source(view, color) for name, view in views.items()}
    if color is not None and not any(sources.values()):
        first = next(iter(views.values()))
        why = first.refusal(color) or nearest(color, first.names)
        raise Error(f"color is {color!r}, which no body drawn has; {why}")
    counts = [len(views[name]) for name in names]
    dots = {}
    for name, count, share in zip(names, counts, common.shares(counts, most), strict=True):
        here = sources[name]
        arrays = views[name].read(["position", *([here] if here else [])])
        rows = common.chosen(count, share)
        colour = None
        if here is not None and color is not None:
            picked = {here: np.asarray(arrays[here])[rows]}
            colour = (
                np.asarray(picked[here], float)
                if picked[here].ndim == 1
                else (common.colours_of(picked, color))
            )
        dots[name] = Dots(arrays["position"][rows], colour)
    return dots, sum(counts)


def draw_dots(
    axes: Any, dots: Mapping[str, Dots], plane: tuple[int, int], norm: Normalize, size: float
) -> Any:
    """Draw bodies seen along the axis that is not in the plane; return the coloured dots or None.

    What is nearer to the viewer, who looks along y and down on x-y, comes last.
    """
    image = None
    for name, body in dots.items():
        hidden = next((a for a in range(body.position.shape[1]) if a not in plane), None)
        position, colour = body.position, body.colour
        if hidden is not None:
            depth = position[:, hidden]
            order = np.argsort(depth if hidden == 2 else -depth, kind="stable")
            position = position[order]
            colour = None if colour is None else colour[order]
        style: dict[str, Any] = {"s": size, "linewidths": 0, "rasterized": True, "label": name}
        x, y = position[:, plane[0]], position[:, plane[1]]
        if colour is None:
            axes.scatter(x, y, color=PLAIN, zorder=2, **style)
        else:
            image = axes.scatter(x, y, c=colour, cmap=COLOUR_MAP, norm=norm, zorder=3, **style)
    return image


def extend_of(values: Sequence[Array], low: float, high: float) -> str:
    """Return at which ends of a colour bar there are values beyond it."""
    finite = [v[np.isfinite(v)] for v in values]
    under = any(bool(np.any(v < low)) for v in finite)
    over = any(bool(np.any(v > high)) for v in finite)
    return {(0, 0): "neither", (1, 0): "min", (0, 1): "max", (1, 1): "both"}[int(under), int(over)]


def plot(
    simulation: Simulation,
    *,
    color: str | None = "speed",
    bodies: Sequence[str] | str | None = None,
    planes: Sequence[str] | str | None = None,
    limits: tuple[float, float] | None = None,
    most: int = common.MOST,
    axes: Any = None,
) -> Any:
    """See `Simulation.plot`."""
    scene = simulation.scene
    vertical = vertical_of(scene)
    planes = common.planes_of(scene.dimension, planes, vertical)
    if axes is not None and len(planes) > 1:
        planes = planes[:1]
    dots, count = sampled_particles(simulation, color, bodies, most)
    coloured = [d.colour for d in dots.values() if d.colour is not None]
    low, high = common.limits_of(coloured) if limits is None else common.check_limits(limits)
    norm = Normalize(low, high)
    drawn = sum(map(len, dots.values()))
    picture = axes.figure if axes is not None else None
    if picture is None:
        size = (8.0, 1.0 + 3.2 * len(planes))
        picture = common.Picture(figsize=size, layout="constrained")
    image = None
    panels = []
    for k, name in enumerate(planes):
        panel = axes if axes is not None else picture.add_subplot(len(planes), 1, k + 1)
        plane = Plane(scene, name, None)
        draw_domain(panel, plane)
        draw_boundaries(panel, plane, scene, later=simulation.time > 0)
        image = draw_dots(panel, dots, plane.axes, norm, dot_size(drawn)) or image
        panels.append(panel)
    if image is not None and color is not None:
        picture.colorbar(image, ax=panels, label=common.label_of(color), shrink=0.85,
                         extend=extend_of(coloured, low, high))  # fmt: skip
    said = [scene.name, f"{simulation.time:.4g} s", common.note(drawn, count)]
    panels[0].set_title(", ".join(x for x in said if x), fontsize=10, loc="left")
    return picture
