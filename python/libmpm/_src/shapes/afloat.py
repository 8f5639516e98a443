"""Bodies at floating equilibrium: how deep they lie, and whether they stay upright."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from libmpm._src.base.arguments import keywords_only
from libmpm._src.base.axes import AXES
from libmpm._src.base.values import Checker, shown, warn
from libmpm._src.errors import SceneError
from libmpm._src.shapes.solid import Array, Corner, Solid
from libmpm._src.shapes.volume import volume_of

__all__ = ["Afloat", "afloat"]

#: Least layers of the body along the vertical, and of parts along another axis.
_LAYERS, _LEAST = 64, 8
#: Parts of the body's box in all.
_PARTS = {2: 1 << 15, 3: 1 << 17}
#: Points on the plane of the water, along one axis and on two.
_LINE, _PLANE = 1 << 13, 1 << 17
#: Part of the body's size below which an offset of its centres, or a height below 0, is none.
_BESIDE = 1e-3


@dataclass(frozen=True)
class Afloat:
    """A body at floating equilibrium in still water; see `afloat`."""

    shape: Solid
    """The solid, moved up or down to where it floats."""
    draught: float
    """Depth of its lowest point below the level, m."""
    displaced: float
    """Volume below the level, m³ (m² in 2D)."""
    volume: float
    """Volume of the whole solid, m³ (m² in 2D)."""
    centre_of_gravity: Corner
    """Centroid of the solid where it floats, (d,) m."""
    centre_of_buoyancy: Corner
    """Centroid of the part below the level, (d,) m."""
    metacentric_height: Corner
    """GM for turns about each horizontal axis, (d - 1,) m, in their order; in 2D in the plane."""
    offset: float
    """Horizontal distance of the two centres, m: 0 where the body does not turn by itself."""

    @property
    def stable(self) -> bool:
        """Whether the body comes back after a small turn: every metacentric height is above 0."""
        return min(self.metacentric_height) > 0


@keywords_only("shapes.afloat", method=False)
def afloat(
    *,
    shape: Solid,
    density: float,
    level: float,
    fluid_density: float = 1000.0,
    axis: str | None = None,
    bed: float | None = None,
) -> Afloat:
    """Return a body where it floats: moved so that the water it displaces weighs what it does.

    =============  =====  ===========  ==========================================================
    parameter      unit   range        meaning
    =============  =====  ===========  ==========================================================
    shape          -      a solid      the body, in its attitude, at any height
    density        kg/m³  > 0          of the body, the same all over; below that of the fluid
    level          m      finite       of the still water, along `axis`
    fluid_density  kg/m³  > 0          of the water
    axis           -      a name       the vertical one, pointing up; None = the last one
    bed            m      below level  where the water ends below; None = deep enough
    =============  =====  ===========  ==========================================================

    The draught d makes ρ_f V(d) = ρ V, with V(d) summed over layers of the solid: exact for boxes
    and upright prisms, within some 1e-3 of the height for others. Debris that is placed so, and
    taken out of the water by ``add_body(..., subtract_from=("water",))`` with `hydrostatic` water,
    starts at rest (Yang 2016, 6.1.3).

    The attitude is kept. The body stays in it if its centres of gravity and buoyancy lie above each
    other and each metacentric height

        GM = KB + I / V_d - KG

    is above 0, with the heights of the centres B and G above any K and the second moment I of the
    plane that the water cuts, about the axis through its middle. Otherwise a `ModelWarning` says
    so. Raises `SceneError`, for a body that sinks or that the bed carries as well.
    """
    check = Checker("shapes.afloat")
    check.instance("shape", shape, (Solid,), "a solid of libmpm.shapes")
    rho = check.number("density", density, lower=0, lower_open=True, unit="kg/m³")
    fluid = check.number("fluid_density", fluid_density, lower=0, lower_open=True, unit="kg/m³")
    level = check.number("level", level, unit="m")
    if bed is not None:
        bed = check.number("bed", bed, upper=level, upper_open=True, unit="m")
    check.finish()
    names = AXES[: shape.dimension]
    if axis is not None and not (isinstance(axis, str) and axis in names):
        raise SceneError(
            f"shapes.afloat: axis is {shown(axis)}; expected one of {', '.join(names)}"
        )
    if rho >= fluid:
        raise SceneError(
            f"shapes.afloat: density is {rho:g} in a fluid of {fluid:g} kg/m³; expected less: it "
            "sinks; put it on the bed"
        )
    up = shape.dimension - 1 if axis is None else names.index(axis)
    low, high = (np.asarray(end, dtype=np.float64) for end in shape.bounds())
    volume = volume_of(shape) if np.all(np.isfinite(high - low)) else math.inf
    if not 0 < volume < math.inf:
        raise SceneError(
            f"shapes.afloat: {shown(shape, 80)} has the volume {volume:g}; expected a body"
        )
    middles, share, edge = _parts(shape, low, high, up)
    draught, low_end = _draught(middles[:, up], share, float(edge[up]), rho / fluid)
    if bed is not None and draught > level - bed:
        raise SceneError(
            f"shapes.afloat: the draught is {draught:g} m above a bed {level - bed:g} m below the "
            "level; expected deeper water: the bed carries it; put it there"
        )
    waterline = low_end + draught
    wet = share * np.clip((waterline - middles[:, up]) / edge[up] + 0.5, 0.0, 1.0)
    gravity = share @ middles / share.sum()
    # The cut layer's wet part lies below its middle.
    centres = middles.copy()
    part = np.clip((waterline - middles[:, up]) / edge[up] + 0.5, 0.0, 1.0)
    centres[:, up] += 0.5 * (part - 1.0) * edge[up]
    buoyancy = wet @ centres / wet.sum()
    displaced = volume * rho / fluid
    level_axes = [a for a in range(shape.dimension) if a != up]
    moments = _plane_moments(shape, low, high, up, waterline)
    heights = [float(buoyancy[up] - gravity[up]) + m / displaced for m in moments]
    offset = float(np.hypot.reduce((buoyancy - gravity)[level_axes]))
    by = np.zeros(shape.dimension)
    by[up] = level - waterline
    found = Afloat(
        shape=shape.moved(tuple(by.tolist())),
        draught=draught,
        displaced=displaced,
        volume=volume,
        centre_of_gravity=tuple((gravity + by).tolist()),
        centre_of_buoyancy=tuple((buoyancy + by).tolist()),
        metacentric_height=tuple(heights),
        offset=offset,
    )
    _remark(found, float(np.max(high - low)))
    return found


def _remark(found: Afloat, size: float) -> None:
    """Warn of a body that does not stay as it is."""
    problems = []
    if found.offset > _BESIDE * size:
        problems.append(
            f"shapes.afloat: the centre of buoyancy lies {found.offset:g} m beside that of "
            "gravity; the body will turn; give it the attitude that it floats in"
        )
    if min(found.metacentric_height) < -_BESIDE * size:
        problems.append(
            f"shapes.afloat: the metacentric height is {min(found.metacentric_height):g} m; below "
            "0 the body turns over; give it the attitude that it floats in"
        )
    if problems:
        warn(problems)


def _parts(shape: Solid, low: Array, high: Array, up: int) -> tuple[Array, Array, Array]:
    """Return middles (n, d) m, filled shares (n,) and edges (d,) m of parts of a solid's box."""
    size = high - low
    step = float(np.prod(size) / _PARTS[len(size)]) ** (1.0 / len(size))
    count = np.maximum(np.round(size / step), _LEAST).astype(int)
    count[up] = max(count[up], _LAYERS)
    edge = size / count
    index = np.indices(tuple(count.tolist())).reshape(len(size), -1).T
    middles = low + (index + 0.5) * edge
    share = np.clip(0.5 - shape.distance(middles) / float(edge.min()), 0.0, 1.0)
    kept = share > 0
    return middles[kept], share[kept], edge


def _draught(height: Array, share: Array, edge: float, ratio: float) -> tuple[float, float]:
    """Return the depth, m, below which lies `ratio` of the volume, and the lowest height.

    The volume below a height is a polygon through those of the layers' faces: its inverse is exact.
    """
    first = float(height.min())
    layer = np.round((height - first) / edge).astype(int)
    below = np.concatenate([[0.0], np.cumsum(np.bincount(layer, weights=share))])
    at = np.interp(ratio * below[-1], below, edge * np.arange(len(below)))
    return float(at), first - 0.5 * edge


def _plane_moments(shape: Solid, low: Array, high: Array, up: int, height: float) -> list[float]:
    """Return the second moments of the cut at a height, m⁴ (m³ in 2D), for turns about each axis.

    Those about horizontal axis a are of the distances along the other one; in 2D there is one.
    """
    axes = [a for a in range(len(low)) if a != up]
    n = _LINE if len(axes) == 1 else math.isqrt(_PLANE)
    lines = [low[a] + (np.arange(n) + 0.5) * (high[a] - low[a]) / n for a in axes]
    grid = np.meshgrid(*lines, indexing="ij")
    points = np.empty((grid[0].size, len(low)))
    points[:, up] = height
    for a, values in zip(axes, grid, strict=True):
        points[:, a] = values.ravel()
    inside = points[shape.distance(points) < 0][:, axes]
    if len(inside) == 0:
        return [0.0] * max(1, len(axes))
    area = float(np.prod([(high[a] - low[a]) / n for a in axes]))
    squares = ((inside - inside.mean(axis=0)) ** 2).sum(axis=0) * area
    return [float(s) for s in squares[::-1]]
