"""One view of a scene in a picture: its bodies, structures, sensors and axes."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.patches import Patch
from numpy.typing import NDArray

from libmpm._src.base.axes import AXES
from libmpm._src.base.palette import FLUIDS, SOLIDS, STRUCTURE
from libmpm._src.pictures.directions import OBLIQUE, View
from libmpm._src.pictures.instruments import (
    draw_sensors,
    draw_sensors_in_space,
    measured_bounds,
)
from libmpm._src.pictures.outlines import (
    MARGIN,
    Plane,
    draw_boundaries,
    draw_domain,
    moves,
    sample_solid,
)
from libmpm._src.pictures.particle_discs import Layer, Splats, Surface
from libmpm._src.sensors.engine_sensors import LoadCell
from libmpm._src.shapes.boxes import Box, DomainWalls

if TYPE_CHECKING:
    from libmpm._src.scene.data import SceneData

__all__ = [
    "COLOUR_MAP",
    "Dots",
    "Panel",
    "body_colours",
    "height_of",
    "legend_of",
    "middle_of",
    "radius_of",
    "width_of",
]

Array = NDArray[np.float64]

#: Colour map of all pictures: even steps of lightness in print, and for the colour-blind.
COLOUR_MAP = "viridis"
#: Places along the longest edge at which the surface of a general structure is looked for.
_PLACES = 110
#: Height of the panel of a tall scene, inches: with its labels and a legend it fits on a page.
_TALLEST = 8.0
#: Width beside it, inches: labels, a colour bar, and so much that no rounding cuts a label off.
_BESIDE = 3.0
#: Radius of balls in views that close no gaps, as a share of the spacing of the lattice that
#: particles came from, so that neighbours overlap: of a solid, and of a fluid, which a flow pulls
#: apart.
_OVERLAP = {False: 0.75, True: 1.1}
#: What is closed around a particle, as a share of a cell or of the spacing: quadratic functions
#: reach over gaps of less than a cell and a half, so that the grid does not part there.
_GAP = 0.75


class Dots:
    """What is drawn of one body: `position` (n, d) m in the world, and `colour` (n,) or None.

    `share` is the part of the body's particles that is drawn.
    """

    def __init__(self, position: Array, colour: Array | None, share: float = 1.0) -> None:
        """Take all three."""
        self.position = position
        self.colour = colour
        self.share = share

    def __len__(self) -> int:
        """Return the number of dots."""
        return len(self.position)


def spacing_of(scene: SceneData, body: str, share: float = 1.0) -> float:
    """Return the distance between neighbours at the start among the particles that are drawn, m."""
    found = next(b for b in scene.bodies if b.name == body)
    per_cell = max(1, found.particles_per_cell or 1)
    made: float = scene.cell_size / (per_cell * max(share, 1e-9)) ** (1.0 / scene.dimension)
    return made


def radius_of(scene: SceneData, body: str, share: float = 1.0) -> float:
    """Return the radius at which balls of a body overlap their neighbours, m."""
    return _OVERLAP[is_fluid(scene, body)] * spacing_of(scene, body, share)


def is_fluid(scene: SceneData, body: str) -> bool:
    """Tell whether a body is of a fluid."""
    return next(b for b in scene.bodies if b.name == body).material.table.stores_volume


def body_colours(scene: SceneData) -> dict[str, str]:
    """Return the colour of every body where no attribute colours it: blue where it is a fluid.

    Bodies whose names differ in a number alone, as pieces of debris do, share one.
    """
    fluids = iter(FLUIDS * len(scene.bodies))
    solids = iter(SOLIDS * len(scene.bodies))
    kinds: dict[str, str] = {}
    found = {}
    for body in scene.bodies:
        kind = _kind(body.name)
        if kind not in kinds:
            kinds[kind] = next(fluids if body.material.table.stores_volume else solids)
        found[body.name] = kinds[kind]
    return found


def _kind(name: str) -> str:
    return re.sub(r"[-_ ]?\d+$", "", name) or name


def legend_of(colours: Mapping[str, str]) -> tuple[list[Any], list[str]]:
    """Return handles and texts of a legend of bodies; those that share a colour have one entry."""
    groups: dict[tuple[str, str], list[str]] = {}
    for name, colour in colours.items():
        groups.setdefault((_kind(name), colour), []).append(name)
    entries = {
        names[0] if len(names) == 1 else f"{kind} ({len(names)})": colour
        for (kind, colour), names in groups.items()
    }
    handles = [Patch(facecolor=c, edgecolor="none") for c in entries.values()]
    return handles, list(entries)


class Panel:
    """Axes that show a scene along an axis, or from above one corner (`name` is "3d")."""

    def __init__(
        self,
        axes: Any,
        scene: SceneData,
        name: str,
        vertical: int,
        *,
        bodies: Sequence[str],
        norm: Normalize,
        later: bool = False,
        cut: Sequence[float] | None = None,
        sensors: bool = True,
        kinds: bool = False,
    ) -> None:
        """Draw all but the particles; `later` = not the start, `cut` (d,) m = a slice there.

        `kinds`: boundaries have the colours of what they do, for a legend; else they are grey.
        """
        self.axes, self._scene = axes, scene
        self._cell = scene.cell_size
        #: The plane; None of the view from above a corner.
        self.plane = None if name == OBLIQUE else Plane(scene, name, cut)
        if self.plane is None:
            self.view = View.oblique(vertical)
            _oblique_axes(axes, scene, self.view, vertical)
        else:
            self.view = View.along(scene.dimension, *self.plane.axes)
            draw_domain(axes, self.plane)
        self._flat = not self.view.deep or cut is not None
        plane = self.plane
        clip = None if plane is None else plane.flat([plane.lower, plane.upper]).T
        self._layer = Layer(self.view, lit=not self._flat, clip=clip)
        if self._flat and plane is not None:
            self._layer.blocked = [
                plane.flat([b.shape.lower, b.shape.upper]).T
                for b in scene.boundaries
                if isinstance(b.shape, Box)
                and not (later and moves(b))
                and plane.meets(b.shape.lower, b.shape.upper)
            ]
        #: label -> colour of what was drawn of the boundaries.
        self.legend: dict[str, str] = {}
        space = scene.dimension == 3 and cut is None
        if space:
            self._layer.surfaces = _structures(scene, later)
        if self.plane is not None:
            self.legend = draw_boundaries(axes, self.plane, scene, later, not space, kinds)
            if sensors:
                draw_sensors(axes, self.plane, scene, vertical)
        elif sensors:
            draw_sensors_in_space(axes, self.view, scene, vertical)
        colours = body_colours(scene)
        #: The particles of each body; `Splats` are scatters of matplotlib.
        self.bodies: dict[str, Splats] = {}
        for body in bodies:
            splats = Splats(body, solid=not is_fluid(scene, body), colour=colours[body])
            splats.set_norm(norm)
            splats.set_cmap(COLOUR_MAP)
            self.bodies[body] = self._layer.add(axes, splats)

    def show(self, dots: Mapping[str, Dots]) -> ScalarMappable | None:
        """Show these particles; return what a colour bar is made of, or None without colours."""
        image = None
        for name, splats in self.bodies.items():
            body = dots.get(name)
            splats.set_visible(body is not None)
            if body is None:
                continue
            position, colour = body.position, body.colour
            plane = self.plane
            if plane is not None and plane.cut is not None and plane.hidden is not None:
                at = plane.cut[plane.hidden] + plane.origin[plane.hidden]
                near = np.abs(position[:, plane.hidden] - at) <= self._cell
                position = position[near]
                colour = None if colour is None else colour[near]
            flat, depth = self.view.project(position)
            if self._flat:  # solids in front, for what is drawn of the water is closed up to them
                depth = np.full(len(depth), 2.0 * self._cell if splats.solid else 0.0)
            spacing = spacing_of(self._scene, name, body.share)
            gap = _GAP * max(self._cell, spacing)
            splats.place(flat, depth, colour, 0.5 * spacing, gap)
            if colour is not None:
                image = splats
        return image

    @property
    def place(self) -> str:
        """What a title says of where the panel cuts the scene; empty where it does not."""
        plane = self.plane
        if plane is None or plane.cut is None or plane.hidden is None:
            return ""
        at = plane.cut[plane.hidden] + plane.origin[plane.hidden]
        return f"cut at {AXES[plane.hidden]} = {at:.4g} m"

    def plain(self, dots: Mapping[str, Dots]) -> dict[str, str]:
        """Return the colours of the bodies shown that no attribute colours."""
        return {
            name: self.bodies[name].plain
            for name, body in dots.items()
            if body.colour is None and name in self.bodies
        }


def middle_of(scene: SceneData) -> list[float]:
    """Return the point (d,) m of a scene through which a slice says most.

    The middle of what carries the first load cell, where that is not a wall; else of the domain.
    """
    lower, upper = np.asarray(scene.lower, np.float64), np.asarray(scene.upper, np.float64)
    for placed in scene.sensors:
        if isinstance(placed.sensor, LoadCell):
            low, high = measured_bounds(scene, placed.sensor)
            return [float(x) for x in 0.5 * (low + high)]
    return [float(x) for x in 0.5 * (lower + upper)]


def height_of(scene: SceneData, name: str, width: float) -> float:
    """Return the height of a panel with its labels, inches, that leaves no room empty."""
    share = _share(scene, name)
    tall = _TALLEST if _TALLEST / share + _BESIDE <= width else min(0.8 * share, 1.6) * width
    return float(max(tall, 1.0)) + 0.8


def width_of(scene: SceneData, names: Sequence[str], most: float) -> float:
    """Return the width of a picture with a panel below the other, inches: `most`, or what tall
    panels and a colour bar beside them need.
    """
    wanted = max(_TALLEST / _share(scene, name) for name in names) + _BESIDE
    return float(np.clip(wanted, min(4.5, most), most))


def _share(scene: SceneData, name: str) -> float:
    """Return the height of what a panel shows, as a share of its width."""
    if name == OBLIQUE:
        return 0.55
    a, b = (AXES.index(x) for x in name)
    wide, tall = (scene.upper[k] - scene.lower[k] for k in (a, b))
    margin = 2.0 * MARGIN * max(wide, tall)
    return float((tall + margin) / (wide + margin))


def _structures(scene: SceneData, later: bool) -> list[Surface]:
    """Return the boundaries in space that have a shape, in the world, where they stand still."""
    origin = np.asarray(scene.origin, np.float64)
    low, high = np.asarray(scene.lower, np.float64), np.asarray(scene.upper, np.float64)
    found = []
    for boundary in scene.boundaries:
        shape = boundary.shape
        if isinstance(shape, DomainWalls) or (later and moves(boundary)):
            continue
        if isinstance(shape, Box):
            lower = np.maximum(np.asarray(shape.lower), low) + origin
            upper = np.minimum(np.asarray(shape.upper), high) + origin
            found.append(Surface(STRUCTURE, lower=lower, upper=upper))
        elif hasattr(shape, "distance"):
            points = _surface_points(shape, low, high)
            if points is not None:
                found.append(Surface(STRUCTURE, points=points[0] + origin, spacing=points[1]))
    return found


def _surface_points(solid: Any, lower: Array, upper: Array) -> tuple[Array, float] | None:
    """Return points (n, 3) m on the surface of a solid, and their spacing, m."""
    sampled = sample_solid(solid, lower, upper, _PLACES)
    if sampled is None:
        return None
    places, distance = sampled
    spacing = max(float(p[1] - p[0]) for p in places)
    slope = np.stack(list(np.gradient(distance, *places)), axis=-1)
    near = np.abs(distance) < spacing
    if not near.any():
        return None
    mesh = np.stack(np.meshgrid(*places, indexing="ij"), axis=-1)[near]
    slope, away = slope[near], distance[near]
    # One step towards the surface along the distance's slope.
    mesh = mesh - slope * (away / np.maximum(np.sum(slope**2, axis=1), 0.25))[:, None]
    inside = np.all((mesh >= lower - spacing) & (mesh <= upper + spacing), axis=1)
    return np.clip(mesh[inside], lower, upper), spacing


def _oblique_axes(axes: Any, scene: SceneData, view: View, vertical: int) -> None:
    """Draw the edges of the domain with their lengths, and set the limits."""
    low = np.asarray(scene.lower, np.float64) + np.asarray(scene.origin)
    high = np.asarray(scene.upper, np.float64) + np.asarray(scene.origin)
    corner = np.array([[(low, high)[(k >> a) & 1][a] for a in range(3)] for k in range(8)])
    flat, depth = view.project(corner)
    nearest = int(np.argmax(depth))
    for k in range(8):
        for a in range(3):
            if k >> a & 1:
                continue
            ends = flat[[k, k | 1 << a]]
            front = nearest in (k, k | 1 << a)
            axes.plot(
                *ends.T, color="0.55", lw=0.7, ls=":" if front else "-", zorder=4 if front else 1
            )
    lowest = [k for k in range(8) if not k >> vertical & 1]
    for a in range(3):
        if a == vertical:
            # The upright edge at the left end of the picture.
            k = min(lowest, key=lambda k: flat[k, 0])
            side: dict[str, Any] = {"ha": "right", "va": "center"}
        else:
            pairs = [k for k in lowest if not k >> a & 1]
            k = min(pairs, key=lambda k: flat[k, 1] + flat[k | 1 << a, 1])
            side = {"ha": "center", "va": "top"}
        middle = flat[[k, k | 1 << a]].mean(axis=0)
        text = f"{AXES[a]}: {low[a]:g} to {high[a]:g} m"
        axes.annotate(text, middle, xytext=(-6, 0) if a == vertical else (0, -6),
                      textcoords="offset points", fontsize=8, color="0.25", **side)  # fmt: skip
    margin = 0.04 * np.ptp(flat, axis=0).max()
    axes.set_xlim(flat[:, 0].min() - 3 * margin, flat[:, 0].max() + margin)
    axes.set_ylim(flat[:, 1].min() - 2 * margin, flat[:, 1].max() + margin)
    axes.set_aspect("equal")
    axes.set_axis_off()
