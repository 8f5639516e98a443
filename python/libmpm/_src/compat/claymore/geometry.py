"""Geometries of ClaymoreUW as solids: where the domain is, and what fills it."""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from libmpm._src.compat.claymore.facilities import BEDS
from libmpm._src.compat.claymore.reader import Context
from libmpm._src.compat.claymore.records import BodyRecord, GeometryRecord
from libmpm._src.shapes.boxes import Box, OrientedBox
from libmpm._src.shapes.point_file import PointFile
from libmpm._src.shapes.primitives import Cylinder, Sphere
from libmpm._src.shapes.prisms import Extrusion
from libmpm._src.shapes.solid import Solid

__all__ = [
    "BEYOND",
    "Fit",
    "bed_solid",
    "cut",
    "files_of",
    "find_file",
    "overlap",
    "place_of",
    "shapes_of",
]

_SMALL = 1e-6
#: Cells by which a boundary reaches out of the domain, so that no node beside it is free.
BEYOND = 6
#: Points on an axis at which two solids are compared.
_PROBES = 24
#: Copies of a body's boxes up to which each becomes a body of its own.
_PIECES = 512
#: Share of a cell by which solids may reach into each other.
_DEPTH = 0.009


@dataclass(frozen=True)
class Fit:
    """The domain: as the file states it, and in whole cells.

    Where the two differ, what ends at a stated wall or beyond it ends at the wall as it is.
    """

    lower: tuple[float, ...]
    stated: tuple[float, ...]
    cells: tuple[int, ...]
    cell_size: float

    @classmethod
    def around(cls, lower: Sequence[float], upper: Sequence[float], cell_size: float) -> Fit:
        """Return the fit of a stated domain: the nearest whole number of cells, at least one."""
        cells = tuple(
            max(1, math.floor((b - a) / cell_size + 0.5 + _SMALL))
            for a, b in zip(lower, upper, strict=True)
        )
        return cls(tuple(lower), tuple(upper), cells, cell_size)

    @property
    def upper(self) -> tuple[float, ...]:
        """Upper corner in whole cells above the lower one, m."""
        ends = zip(self.lower, self.stated, self.cells, strict=True)
        found = []
        for low, stated, n in ends:
            high = low + n * self.cell_size
            found.append(stated if abs(high - stated) < _SMALL * self.cell_size else high)
        return tuple(found)

    @property
    def box(self) -> Box:
        """The domain."""
        return Box(lower=self.lower, upper=self.upper)

    def moved_walls(self) -> list[str]:
        """Say where walls are not where the file has them."""
        return [
            f"the upper wall on axis {'xyz'[a]} is at {here:g} m instead of {stated:g} m, a whole "
            f"number of cells of {self.cell_size:g} m; what ends at it ends there"
            for a, (here, stated) in enumerate(zip(self.upper, self.stated, strict=True))
            if here != stated
        ]

    def end(self, a: int, x: float) -> float:
        """Return where a coordinate on an axis is: on the wall if the file has it there."""
        slack = _SMALL * self.cell_size
        here = self.upper[a]
        if x >= self.stated[a] - slack:
            return here
        return max(self.lower[a], min(_tidy(x), here))

    def inside(self, lower: Sequence[float], upper: Sequence[float]) -> Box | None:
        """Return a stated box in the domain; None where nothing of it is left."""
        low = [self.end(a, x) for a, x in enumerate(lower)]
        high = [self.end(a, x) for a, x in enumerate(upper)]
        if any(b - a <= _SMALL * self.cell_size for a, b in zip(low, high, strict=True)):
            return None
        return Box(lower=low, upper=high)

    def beyond(self, a: int, x: float, outward: int) -> float:
        """Return a coordinate of a boundary: well outside the domain if it reaches its edge."""
        slack = _SMALL * self.cell_size
        past = BEYOND * self.cell_size
        if outward > 0:
            return max(x, self.upper[a]) + past if x >= self.stated[a] - slack else x
        return min(x, self.lower[a]) - past if x <= self.lower[a] + slack else x


def _tidy(x: float) -> float:
    """Return a sum of stated numbers without the rounding of the sum."""
    return float(f"{x:.12g}")


def place_of(box: Box, fit: Fit) -> Box | None:
    """Return the cells that a box boundary will block, at least one on each axis, as a box."""
    low, high = [], []
    for a, (x, y) in enumerate(zip(box.lower, box.upper, strict=True)):
        first = math.floor((x - fit.lower[a]) / fit.cell_size + 0.5 + _SMALL)
        last = math.floor((y - fit.lower[a]) / fit.cell_size + 0.5 + _SMALL)
        if last <= first:
            first = math.floor((0.5 * (x + y) - fit.lower[a]) / fit.cell_size)
            last = first + 1
        if last <= 0 or first >= fit.cells[a]:
            return None
        low.append(fit.lower[a] + first * fit.cell_size)
        high.append(fit.lower[a] + last * fit.cell_size)
    return Box(lower=low, upper=high)


def bed_solid(profile: Sequence[tuple[float, float]], fit: Fit) -> Solid:
    """Return what lies below a bed y(x), across the whole domain; level beyond its ends."""
    past = BEYOND * fit.cell_size
    low, high = fit.lower[0] - past, fit.upper[0] + past
    inner = [(x, y) for x, y in profile if low < x < high]
    points = [(low, _height(profile, low)), *inner, (high, _height(profile, high))]
    base = min(fit.lower[1], min(y for _, y in points)) - past
    corners = [(low, base), *points, (high, base)]
    sides = fit.lower[2] - past, fit.upper[2] + past
    return Extrusion(profile=corners, axis="z", lower=sides[0], upper=sides[1])


def _height(profile: Sequence[tuple[float, float]], x: float) -> float:
    if x <= profile[0][0]:
        return profile[0][1]
    for (a, low), (b, high) in itertools.pairwise(profile):
        if a <= x <= b and b > a:
            return low + (high - low) * (x - a) / (b - a)
    return profile[-1][1]


def shapes_of(context: Context, body: BodyRecord, fit: Fit, beds: Sequence[str]) -> list[Solid]:
    """Return the solids that a body fills.

    Boxes that do not touch come one by one, anything else as one solid. `beds` are the facilities
    whose bed is a boundary, which cuts the body anyway.
    """
    whole: Solid | None = None
    apart = body.law != "fluid"
    pieces: list[Solid] = []
    for geometry in body.geometry:
        solids = _copies(context, geometry, fit, beds)
        if geometry.operation == "add":
            pieces += solids
        apart &= geometry.operation == "add"
        apart &= all(isinstance(s, Box | OrientedBox) for s in solids)
        for solid in solids if geometry.operation != "intersect" else _united(solids):
            if geometry.operation == "add":
                whole = solid if whole is None else whole | solid
            elif whole is None:
                context.note(f"{geometry.path}: there is nothing yet to {geometry.operation} from")
            elif geometry.operation == "subtract":
                whole = cut(whole, solid, fit.cell_size)
            else:
                whole = whole & solid
    if whole is None:
        return []
    if apart and 1 < len(pieces) <= _PIECES and not _touching(pieces):
        return pieces
    return [whole]


def _united(solids: list[Solid]) -> list[Solid]:
    whole = solids[0] if solids else None
    for one in solids[1:]:
        whole = one if whole is None else whole | one
    return [] if whole is None else [whole]


def _touching(pieces: Sequence[Solid]) -> bool:
    """Return whether the boxes around any two pieces share more than a face."""
    for one, two in itertools.combinations(pieces, 2):
        ends = zip(*one.bounds(), *two.bounds(), strict=True)
        if all(min(b, d) - max(a, c) > _SMALL for a, b, c, d in ends):
            return True
    return False


def _copies(context: Context, one: GeometryRecord, fit: Fit, beds: Sequence[str]) -> list[Solid]:
    """Return the copies of a geometry, turned and within the domain."""
    steps = [[i * s for i in range(n)] for n, s in zip(one.array, one.spacing, strict=True)]
    turned = any(one.rotate)
    if turned and one.operation != "add":
        context.note(f"{one.path}: rotate holds; ClaymoreUW does not turn what it subtracts")
    found, lost = [], 0
    for by in itertools.product(*steps):
        offset = tuple(_tidy(x + v) for x, v in zip(one.offset, by, strict=True))
        solid = _solid(context, replace(one, offset=offset), fit, beds, turned)
        if solid is not None and turned:
            solid = _turn(solid, one)
        if solid is not None and (turned or not isinstance(solid, Box)):
            solid = _clipped(solid, one, fit)
        if solid is None:
            lost += 1
        else:
            found.append(solid)
    if lost and one.operation == "add":
        context.note(f"{one.path}: {lost} of {lost + len(found)} copies lie outside the domain")
    return found


def _turn(solid: Solid, one: GeometryRecord) -> Solid:
    """Return a solid turned about the file's axes through the fulcrum, first x, then y, then z."""
    for axis, angle in zip("xyz", one.rotate, strict=True):
        if angle:
            solid = solid.turned(angle, axis, one.fulcrum)
    return solid


def _clipped(solid: Solid, one: GeometryRecord, fit: Fit) -> Solid | None:
    if one.operation != "add":
        return solid
    low, high = solid.bounds()
    slack = 1e-9
    within = all(
        a >= c - slack and b <= d + slack
        for a, b, c, d in zip(low, high, fit.lower, fit.upper, strict=True)
    )
    if within:
        return solid
    apart = any(
        b <= c or a >= d for a, b, c, d in zip(low, high, fit.lower, fit.upper, strict=True)
    )
    return None if apart else solid & fit.box


def _solid(
    context: Context,
    one: GeometryRecord,
    fit: Fit,
    beds: Sequence[str],
    turned: bool,
) -> Solid | None:
    """Return one copy of a geometry before it is turned."""
    upper = tuple(_tidy(x + s) for x, s in zip(one.offset, one.span, strict=True))
    if one.object in ("box", "level"):
        if turned or one.operation != "add":
            return Box(lower=one.offset, upper=upper)
        return fit.inside(one.offset, upper)
    if one.object in ("cylinder", "sphere"):
        return _round(one, upper)
    # Water of a facility or over a bathymetry, or a bathymetry to take away.
    profile = one.bathymetry or _facility_profile(one)
    if one.object == "bathymetry" and one.operation != "add":
        return bed_solid(profile, fit)
    if one.level is not None and abs(one.level - upper[1]) > _SMALL:
        context.note(
            f"{one.path}: standing_water_level is {one.level:g} m, offset and span reach "
            f"{upper[1]:g} m; the latter is taken, as ClaymoreUW does"
        )
    water = Box(lower=one.offset, upper=upper) if turned else fit.inside(one.offset, upper)
    held = "custom" if one.bathymetry else one.object
    if water is None or (held in beds and not turned):
        return water
    return cut(water, bed_solid(profile, fit), fit.cell_size)


def _facility_profile(one: GeometryRecord) -> tuple[tuple[float, float], ...]:
    bed = BEDS[one.object]
    shift = one.offset[0] + bed.water_shift - bed.profile[0][0]
    return tuple((x + shift, y + one.offset[1]) for x, y in bed.profile)


def _round(one: GeometryRecord, upper: Sequence[float]) -> Solid:
    """Return a sphere or cylinder, whose box begins at the offset, as far as its span goes."""
    centre = [x + one.radius for x in one.offset]
    if one.object == "sphere":
        solid: Solid = Sphere(centre=centre, radius=one.radius)
        along = -1
    else:
        along = "xyz".index(one.axis)
        start, end = list(centre), list(centre)
        start[along], end[along] = one.offset[along], upper[along]
        solid = Cylinder(start=start, end=end, radius=one.radius)
    across = [s for a, s in enumerate(one.span) if a != along]
    if one.operation == "add" and min(across) < 2 * one.radius * (1 - _SMALL):
        solid = solid & Box(lower=one.offset, upper=upper)
    return solid


def files_of(
    context: Context, body: BodyRecord, folder: Path, particle_volume: float
) -> list[PointFile]:
    """Return the particles of a body that is read from files, one for each copy.

    `particle_volume` is that of ClaymoreUW, Δx³/ppc in m³.
    """
    found = []
    if any(g.object != "file" for g in body.geometry):
        context.fail(body.path, "has files and other geometry, which is refused; make the files a "
                     "body of their own")  # fmt: skip
        return []
    for one in body.geometry:
        path = _particle_file(context, one, folder)
        if path is None:
            continue
        steps = [[i * s for i in range(n)] for n, s in zip(one.array, one.spacing, strict=True)]
        for by in itertools.product(*steps):
            offset = tuple(x + v for x, v in zip(one.offset, by, strict=True))
            found.append(PointFile(file=str(path), particle_volume=particle_volume, offset=offset))
    return found


def _particle_file(context: Context, one: GeometryRecord, folder: Path) -> Path | None:
    """Return the file of a geometry; None and a problem where it cannot be read."""
    name = one.file or ""
    kind = Path(name).suffix.lower()
    if kind in (".bgeo", ".geo", ".pdb", ".ptc") or one.attributes:
        context.fail(
            one.path,
            f"names the checkpoint '{name}', which is refused: states of ClaymoreUW are not read; "
            "run the scene that wrote it here and continue from its checkpoint, "
            "load(path, checkpoint=...)",
        )
    elif kind not in (".csv", ".txt", ".xyz", ".npy"):
        context.fail(
            one.path,
            f"names the file '{name}', which is refused: positions of particles as .csv are read; "
            "sample the shape first, or describe it by box, sphere and cylinder",
        )
    elif one.operation != "add" or any(one.rotate):
        context.fail(one.path, f"turns or subtracts the file '{name}', which is refused; do so in "
                     "the file")  # fmt: skip
    else:
        path = find_file(folder, name)
        if path is not None:
            return path
        context.fail(one.path, f"names '{name}', which is not in {folder}; put it there")
    return None


def find_file(folder: Path, name: str) -> Path | None:
    """Return a file by its path, or by its name alone, in a folder."""
    for candidate in (folder / name, folder / Path(name.replace("\\", "/")).name):
        # A name may be too long for the system, or hold what no name does.
        with contextlib.suppress(OSError, ValueError):
            if name and candidate.is_file():
                return candidate
    return None


def overlap(one: Solid, two: Solid, cell_size: float) -> float:
    """Return the share of the points probed at which two solids are both deeper than a rounding."""
    low = np.maximum(*(np.asarray(s.bounds()[0]) for s in (one, two)))
    high = np.minimum(*(np.asarray(s.bounds()[1]) for s in (one, two)))
    slack = _DEPTH * cell_size
    if np.any(high - low <= slack) or not np.all(np.isfinite(high - low)):
        return 0.0
    # The middles of equal slices, and beside the faces.
    axes = [
        np.unique(np.concatenate([
            a + (np.arange(_PROBES) + 0.5) / _PROBES * (b - a), [a + slack, b - slack]
        ]))
        for a, b in zip(low, high, strict=True)
    ]  # fmt: skip
    points = np.stack([m.ravel() for m in np.meshgrid(*axes, indexing="ij")], axis=1)
    near = points[one.distance(points) < -0.5 * slack]
    if not len(near):
        return 0.0
    return float(np.count_nonzero(two.distance(near) < -0.5 * slack)) / len(points)


def cut(whole: Solid, blocker: Solid, cell_size: float) -> Solid | None:
    """Return a solid without another: itself where they are apart, None where nothing is left."""
    if overlap(whole, blocker, cell_size) == 0:
        return whole
    if isinstance(whole, Box) and isinstance(blocker, Box):
        low, high = list(whole.lower), list(whole.upper)
        left = []
        for a in range(whole.dimension):
            if blocker.lower[a] > low[a] + _SMALL or blocker.upper[a] < high[a] - _SMALL:
                left.append(a)
        if not left:
            return None
        a = left[0]
        if len(left) == 1 and blocker.lower[a] <= low[a] + _SMALL:
            low[a] = blocker.upper[a]
            return Box(lower=low, upper=high)
        if len(left) == 1 and blocker.upper[a] >= high[a] - _SMALL:
            high[a] = blocker.lower[a]
            return Box(lower=low, upper=high)
    return whole - blocker
