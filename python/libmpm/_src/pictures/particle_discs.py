"""Particles drawn as large as they are, nearest to the viewer in front.

Every particle is a disc, or in space a ball, of the size of the material it stands for, so that a
body is a surface and not a cloud of dots whatever the size of the picture. In space what is behind
something is hidden by it, and surfaces are lit: the depth of every pixel is smoothed and its slope
is the normal, as in screen-space rendering of fluids.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.collections import PathCollection
from matplotlib.colors import to_rgb
from matplotlib.image import BboxImage
from matplotlib.path import Path
from numpy.typing import NDArray

if TYPE_CHECKING:
    from libmpm._src.pictures.directions import View

__all__ = ["Layer", "Splats", "Surface"]

Array = NDArray[np.float64]

#: Direction towards the light: right, up, towards the viewer.
_LIGHT = np.array([-0.42, 0.58, 0.70]) / math.sqrt(0.42**2 + 0.58**2 + 0.70**2)
#: Share of light that reaches what is turned away from it.
_AMBIENT = 0.42
#: Pixels of the buffer for which every pixel of the picture is taken twice each way.
_FINE = 3_000_000
#: Repetitions of the smoothing of depths.
_SMOOTHINGS = 8
#: How dark the outline of a solid is.
_OUTLINE = 0.35


class Splats(PathCollection):
    """The particles of one body in a panel: offsets, colours and norm of a scatter.

    `radius` is that of a particle, m, `depth` (n,) m towards the viewer. The `Layer` of its panel
    draws it.
    """

    def __init__(self, name: str, radius: float, *, solid: bool, colour: str) -> None:
        """Take no particles yet."""
        super().__init__([Path.unit_circle()], sizes=[1.0], offsets=np.empty((0, 2)))
        self.set_label(name)
        self.set_facecolor(colour)
        self.radius = radius
        self.solid = solid
        self.plain = colour
        self.depth: Array = np.empty(0)

    def place(self, flat: Array, depth: Array, values: Array | None) -> None:
        """Take positions (n, 2) m in the picture, depths (n,) m, and what colours them."""
        self.set_offsets(flat)
        self.depth = depth
        self.set_array(values)

    def draw(self, renderer: Any) -> None:
        """Leave it to the layer."""

    def colours(self) -> Array:
        """Return the colour (n, 3) of every particle."""
        values = self.get_array()
        if values is None:
            return np.broadcast_to(np.array(to_rgb(self.plain)), (len(self.depth), 3))
        return np.asarray(self.to_rgba(values))[:, :3]


@dataclass(frozen=True)
class Surface:
    """A structure in space: a box by its corners, or points (n, 3) m on a surface.

    `spacing` is the distance between neighbouring points, m.
    """

    colour: str
    lower: Array | None = None
    upper: Array | None = None
    points: Array | None = None
    spacing: float = 0.0


class Layer(Artist):
    """All bodies and structures of a panel, drawn together."""

    def __init__(self, view: View) -> None:
        """Take how the panel looks at the scene."""
        super().__init__()
        self.view = view
        self.bodies: list[Splats] = []
        self.surfaces: list[Surface] = []
        self.set_zorder(2)

    def add(self, axes: Any, body: Splats) -> Splats:
        """Put a body into the panel `axes`."""
        if self.axes is None:
            axes.add_artist(self)
        body.set_offset_transform(axes.transData)
        axes.add_collection(body, autolim=False)
        self.bodies.append(body)
        return body

    def draw(self, renderer: Any) -> None:
        """Draw at the resolution of the figure."""
        if self.axes is None or not self.get_visible():
            return
        box = self.axes.bbox
        size = np.ceil([box.width, box.height]).astype(int)
        if np.any(size < 2):
            return
        fine = 2 if 4 * size[0] * size[1] <= _FINE else 1
        frame = _Frame(self.axes, size[0] * fine, size[1] * fine)
        for number, body in enumerate(self.bodies):
            if body.get_visible() and len(body.depth):
                frame.splat(np.asarray(body.get_offsets()), body.depth, body.radius, number)
        for number, surface in enumerate(self.surfaces, len(self.bodies)):
            if surface.points is not None:
                flat, depth = self.view.project(surface.points)
                frame.splat(flat, depth, 0.8 * surface.spacing, number)
            elif surface.lower is not None and surface.upper is not None:
                frame.box(self.view, surface.lower, surface.upper, number)
        image = frame.image(self.bodies, self.surfaces, lit=self.view.deep)
        artist = BboxImage(box, origin="lower", interpolation="antialiased")
        artist.set_data(_halved(image) if fine == 2 else image)
        artist.set_zorder(self.get_zorder())
        figure = self.get_figure()
        if figure is not None:
            artist.set_figure(figure)
        artist.draw(renderer)


class _Frame:
    """What every pixel shows: which particle of which body, and how near it is."""

    def __init__(self, axes: Any, width: int, height: int) -> None:
        self._low, self._high = (
            np.array([a, b]) for a, b in zip(axes.get_xlim(), axes.get_ylim(), strict=True)
        )
        self._shape = (height, width)
        self._per_metre = np.array([width, height]) / (self._high - self._low)
        self.depth = np.full(self._shape, -np.inf)
        self._owner = np.full(self._shape, -1, np.int32)
        self._row = np.zeros(self._shape, np.int64)
        self._fixed: dict[int, Array] = {}

    def splat(self, flat: Array, depth: Array, radius: float, owner: int) -> None:
        """Add balls (n,) of one radius, m."""
        height, width = self._shape
        scale = float(abs(self._per_metre[0]))
        pixels = max(radius * scale, 0.75)  # spray stays visible
        at = (flat - self._low) * self._per_metre
        reach = math.ceil(pixels)
        inside = np.all((at > -reach) & (at < [width + reach, height + reach]), axis=1)
        rows = np.flatnonzero(inside)
        at, near = at[rows], depth[rows]
        if not len(rows):
            return
        # One integer tells depth first and then which particle, so that one maximum finds both.
        # What was drawn before competes by its depth alone.
        found = np.full(height * width, -1, np.int64)
        base, span = float(near.min()), float(np.ptp(near)) + radius + 1e-300
        corner = np.floor(at).astype(np.int64)
        bits = max(1, len(rows).bit_length())
        levels = 2.0 ** (61 - bits)
        number = np.arange(len(rows), dtype=np.int64)
        for dy in range(-reach, reach + 1):
            for dx in range(-reach, reach + 1):
                x, y = corner[:, 0] + dx, corner[:, 1] + dy
                away = ((x + 0.5 - at[:, 0]) ** 2 + (y + 0.5 - at[:, 1]) ** 2) / pixels**2
                ok = (away <= 1.0) & (x >= 0) & (x < width) & (y >= 0) & (y < height)
                if dx == 0 == dy:
                    ok |= (x >= 0) & (x < width) & (y >= 0) & (y < height)
                    away = np.minimum(away, 1.0)
                if not ok.any():
                    continue
                bump = radius * np.sqrt(1.0 - away[ok])
                level = ((near[ok] + bump - base) / span * levels).astype(np.int64)
                key = (level << bits) | number[ok]
                np.maximum.at(found, y[ok] * width + x[ok], key)
        hit = np.flatnonzero(found >= 0)
        keys = found[hit]
        depths = (keys >> bits) / levels * span + base
        self._take(hit, depths, owner, rows[keys & ((1 << bits) - 1)])

    def _take(self, pixels: NDArray[Any], depths: Array, owner: int, rows: NDArray[Any]) -> None:
        """Give pixels to `owner` where it is nearer than what they show."""
        front = depths > self.depth.ravel()[pixels]
        pixels = pixels[front]
        self.depth.reshape(-1)[pixels] = depths[front]
        self._owner.reshape(-1)[pixels] = owner
        self._row.reshape(-1)[pixels] = rows[front]

    def box(self, view: View, lower: Array, upper: Array, owner: int) -> None:
        """Add a box by the place at which each line of sight enters it."""
        height, width = self._shape
        u = self._low[0] + (np.arange(width) + 0.5) / self._per_metre[0]
        v = self._low[1] + (np.arange(height) + 0.5) / self._per_metre[1]
        first = np.full(self._shape, -np.inf)  # depth at which a line leaves the box, behind
        last = np.full(self._shape, np.inf)
        normal = np.zeros(self._shape, np.int8)
        for axis in range(3):
            along = view.towards[axis]
            base = view.right[axis] * u[None, :] + view.up[axis] * v[:, None]
            if abs(along) < 1e-9:
                outside = (base < lower[axis]) | (base > upper[axis])
                last = np.where(outside, -np.inf, last)
                continue
            a, b = (lower[axis] - base) / along, (upper[axis] - base) / along
            near, far = np.maximum(a, b), np.minimum(a, b)
            normal = np.where(near < last, axis, normal).astype(np.int8)
            last, first = np.minimum(last, near), np.maximum(first, far)
        hit = np.flatnonzero((last > first) & np.isfinite(last))
        self._take(hit, last.ravel()[hit], owner, normal.ravel()[hit].astype(np.int64))
        facing = np.sign(view.towards)
        basis = np.stack([view.right, view.up, view.towards])
        self._fixed[owner] = np.array([basis[:, k] * facing[k] for k in range(3)])

    def image(self, bodies: Sequence[Splats], surfaces: Sequence[Surface], lit: bool) -> Array:
        """Return the picture (height, width, 4) of numbers from 0 to 1."""
        image = np.zeros((*self._shape, 4))
        shown = self._owner >= 0
        solid = np.zeros(self._shape, bool)
        for number in np.unique(self._owner[shown]):
            here = self._owner == number
            if number < len(bodies):
                image[here, :3] = bodies[number].colours()[self._row[here]]
                solid |= here & bodies[number].solid
            else:
                image[here, :3] = to_rgb(surfaces[number - len(bodies)].colour)
                solid |= here
        image[..., 3] = shown
        if lit:
            image[..., :3] *= self._light(shown)[..., None]
        edge = np.zeros(self._shape, bool)
        for axis in (0, 1):
            for step in (1, -1):
                edge |= solid & (np.roll(self._owner, step, axis) != self._owner)
        image[edge, :3] *= _OUTLINE
        return image

    def _light(self, shown: NDArray[np.bool_]) -> Array:
        """Return the share of light of every pixel."""
        depth = np.where(shown, self.depth, 0.0)
        pixel = 1.0 / abs(float(self._per_metre[0]))
        reach = 6 * pixel * max(1.0, max(self._shape) / 400)
        for _ in range(_SMOOTHINGS):
            total, weight = depth.copy(), np.ones(self._shape)
            for axis in (0, 1):
                for step in (1, -1):
                    other = np.roll(depth, step, axis)
                    near = (np.roll(self._owner, step, axis) == self._owner) & (
                        np.abs(other - depth) < reach
                    )
                    total += np.where(near, other, 0.0)
                    weight += near
            depth = total / weight
        slope = []
        for axis in (1, 0):
            ahead, behind = np.roll(depth, -1, axis), np.roll(depth, 1, axis)
            one = (np.roll(self._owner, -1, axis) == self._owner) & (np.abs(ahead - depth) < reach)
            two = (np.roll(self._owner, 1, axis) == self._owner) & (np.abs(behind - depth) < reach)
            rise = np.where(one, ahead - depth, 0.0) + np.where(two, depth - behind, 0.0)
            slope.append(rise / np.maximum(one.astype(float) + two, 1) / pixel)
        normal = np.stack([-slope[0], -slope[1], np.ones(self._shape)], axis=-1)
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        for owner, faces in self._fixed.items():
            here = self._owner == owner
            normal[here] = faces[self._row[here]]
        lit: Array = _AMBIENT + (1.0 - _AMBIENT) * np.clip(normal @ _LIGHT, 0.0, 1.0) * 1.25
        return np.clip(lit, 0.0, 1.12)


def _halved(image: Array) -> Array:
    """Return the mean of every two by two pixels, colours weighted by what covers them."""
    height, width = image.shape[0] // 2 * 2, image.shape[1] // 2 * 2
    blocks = image[:height, :width].reshape(height // 2, 2, width // 2, 2, 4)
    cover = blocks[..., 3:]
    colour = (blocks[..., :3] * cover).sum(axis=(1, 3)) / np.maximum(cover.sum(axis=(1, 3)), 1e-9)
    found: Array = np.clip(np.concatenate([colour, cover.mean(axis=(1, 3))], axis=-1), 0.0, 1.0)
    return found
