"""What every pixel of a picture shows: bodies without gaps, nearest in front, lit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from libmpm._src.pictures.directions import View

__all__ = ["Painted", "Pixels", "halved"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Direction towards the light: right, up, towards the viewer.
_LIGHT = np.array([-0.42, 0.58, 0.70]) / math.sqrt(0.42**2 + 0.58**2 + 0.70**2)
#: Share of light that reaches what is turned away from it.
_AMBIENT = 0.42
#: Radius of a particle in pixels at least, so that spray stays visible.
_LEAST = 0.75
#: What is added where nothing is closed, pixels: centres are those of pixels.
_ROUNDING = 0.5
#: How dark the outline of a solid is.
_OUTLINE = 0.35


@dataclass(frozen=True)
class Painted:
    """How one owner of pixels looks: colours (n, 3) by particle, and whether it has an outline."""

    colours: Array
    solid: bool


class Pixels:
    """Which particle of which body every pixel shows, and how near it is."""

    def __init__(
        self,
        limits: Array,
        width: int,
        height: int,
        clip: Array | None = None,
        blocked: Sequence[Array] = (),
    ) -> None:
        """Take the limits (2, 2) m of the axes and, alike, those that nothing is drawn beyond.

        Nor is anything in the rectangles `blocked`.
        """
        self._low = limits[:, 0]
        self._shape = (height, width)
        self._per_metre = np.array([width, height]) / (limits[:, 1] - limits[:, 0])
        self._clip, self._blocked = clip, blocked
        self._depth = np.full(self._shape, -np.inf)
        self._owner = np.full(self._shape, -1, np.int32)
        self._row = np.zeros(self._shape, np.int64)
        #: Of an owner: normals by number of row; and over how many pixels its surface is smoothed.
        self._fixed: dict[int, Array] = {}
        self._bumps: dict[int, float] = {}

    @property
    def _scale(self) -> float:
        return float(abs(self._per_metre[0]))

    def body(self, flat: Array, depth: Array, radius: float, gap: float, owner: int) -> None:
        """Add balls (n,) of one radius, m; gaps between them of up to twice `gap`, m, are closed.

        Positions are (n, 2) m in the picture, depths (n,) m. Closing takes what is farther than
        `gap` from all that is farther than `radius` + `gap` from every particle.
        """
        grown = gap * self._scale
        if grown < 1.0:
            gap = grown = 0.0
        pixels = max(radius * self._scale, _LEAST) + (grown or _ROUNDING)
        found = self._nearest(flat, depth, pixels)
        if found is None:
            return
        (left, low), depths, rows = found
        hit = np.isfinite(depths)
        inside = self._inside(left, low, hit.shape)
        if grown:
            # Walls and structures count as filled, so that gaps at them are closed as well.
            hit &= _eroded(hit | ~inside, grown)
            depths = depths - gap
        y, x = np.nonzero(hit & inside)
        depths, rows = depths[y, x], rows[y, x]
        y, x = y + low, x + left
        here = (x >= 0) & (x < self._shape[1]) & (y >= 0) & (y < self._shape[0])
        pixel = y[here] * self._shape[1] + x[here]
        self._take(pixel, depths[here], owner, rows[here])
        self._bumps[owner] = pixels

    def _inside(self, left: int, low: int, shape: tuple[int, ...]) -> Mask:
        """Return the pixels of a window in which particles may be drawn."""
        u = self._low[0] + (np.arange(left, left + shape[1]) + 0.5) / self._per_metre[0]
        v = self._low[1] + (np.arange(low, low + shape[0]) + 0.5) / self._per_metre[1]
        found = np.ones(shape, bool)
        if self._clip is not None:
            found = _within(u, v, self._clip)
        for rectangle in self._blocked:
            found &= ~_within(u, v, rectangle)
        return found

    def _nearest(
        self, flat: Array, depth: Array, pixels: float
    ) -> tuple[tuple[int, int], Array, NDArray[np.int64]] | None:
        """Return what is nearest to the viewer at each pixel around particles.

        The corner (left, low) of a window that holds all discs, which may reach beyond the picture,
        and its depths, m, minus infinity where no disc is, and numbers of particles.
        """
        height, width = self._shape
        reach = math.ceil(pixels)
        at = (flat - self._low) * self._per_metre
        rows = np.flatnonzero(
            np.all((at > -reach) & (at < [width + reach, height + reach]), axis=1)
        )
        if not len(rows):
            return None
        corner = np.floor(at[rows]).astype(np.int64)
        near = depth[rows]
        left, low = corner.min(axis=0) - reach
        right, high = corner.max(axis=0) + reach + 1
        across = int(right - left)
        # One integer tells depth first and then which particle, so that one maximum finds both.
        ball = pixels / self._scale
        base, span = float(near.min()), float(np.ptp(near)) + ball + 1e-300
        bits = max(1, len(rows).bit_length())
        levels = 2.0 ** (61 - bits)
        level = ((near - base) / span * levels).astype(np.int64)
        place = (corner[:, 1] - low) * across + corner[:, 0] - left
        found = np.full(across * int(high - low), -1, np.int64)
        np.maximum.at(found, place, (level << bits) | np.arange(len(rows)))
        place = np.flatnonzero(found >= 0)  # of particles in one pixel only the nearest counts
        keys = found[place]
        offsets = np.arange(-reach, reach + 1)
        for dy in offsets:
            for dx in offsets:
                away = (dx * dx + dy * dy) / pixels**2
                if away > 1.0:
                    continue
                bump = int(ball * math.sqrt(1.0 - away) / span * levels) << bits
                there = place + (dy * across + dx)
                found[there] = np.maximum(found[there], keys + bump)
        shape = (int(high - low), across)
        depths = np.where(found < 0, -np.inf, (found >> bits) / levels * span + base)
        numbers = rows[np.where(found < 0, 0, found & ((1 << bits) - 1))]
        return (int(left), int(low)), depths.reshape(shape), numbers.reshape(shape)

    def _take(self, pixels: NDArray[Any], depths: Array, owner: int, rows: NDArray[Any]) -> None:
        """Give pixels to `owner` where it is nearer than what they show."""
        front = depths > self._depth.ravel()[pixels]
        pixels = pixels[front]
        self._depth.reshape(-1)[pixels] = depths[front]
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

    def image(self, painted: Sequence[Painted], *, lit: bool) -> Array:
        """Return the picture (height, width, 4) of numbers from 0 to 1."""
        image = np.zeros((*self._shape, 4))
        shown = self._owner >= 0
        if not shown.any():
            return image
        y, x = np.nonzero(shown)
        part = (slice(max(y.min() - 1, 0), y.max() + 2), slice(max(x.min() - 1, 0), x.max() + 2))
        owner, row, here = self._owner[part], self._row[part], image[part]
        solid = np.zeros(owner.shape, bool)
        for number in np.unique(self._owner[shown]):
            mine = owner == number
            look = painted[number]
            rows = row[mine] if len(look.colours) > 1 else 0
            here[mine, :3] = look.colours[rows]
            solid |= mine & look.solid
        here[..., 3] = shown[part]
        if lit:
            here[..., :3] *= self._light(part)[..., None]
        edge = np.zeros(owner.shape, bool)
        for axis in (0, 1):
            for step in (1, -1):
                edge |= solid & (_shifted(owner, step, axis) != owner)
        here[edge, :3] *= _OUTLINE
        return image

    def _light(self, part: tuple[slice, slice]) -> Array:
        """Return the share of light of the pixels of a part: by the slope of the smoothed depth."""
        owner = self._owner[part]
        shown = owner >= 0
        middle = self._depth[part][shown].mean()
        depth = np.where(shown, self._depth[part] - middle, 0.0).astype(np.float32)
        pixel = 1.0 / self._scale
        bump = np.zeros(
            owner.shape, np.float32
        )  # radius of the balls that the smoothing levels, pixels
        for number, pixels in self._bumps.items():
            bump[owner == number] = pixels
        reach = (np.maximum(1.5 * bump, 6.0) * pixel).astype(np.float32)
        step, widest = 1, float(bump.max())
        while step == 1 or step <= 0.6 * widest:
            for _ in range(2):
                total, weight = depth.copy(), np.ones(owner.shape, np.float32)
                for axis in (0, 1):
                    for way in (step, -step):
                        other = _shifted(depth, way, axis)
                        near = (_shifted(owner, way, axis) == owner) & (
                            np.abs(other - depth) < reach
                        )
                        near &= step <= np.maximum(0.6 * bump, 1.0)
                        total += np.where(near, other, np.float32(0.0))
                        weight += near
                depth = total / weight
            step *= 2
        slope = []
        for axis in (1, 0):
            ahead, behind = _shifted(depth, -1, axis), _shifted(depth, 1, axis)
            one = (_shifted(owner, -1, axis) == owner) & (np.abs(ahead - depth) < reach)
            two = (_shifted(owner, 1, axis) == owner) & (np.abs(behind - depth) < reach)
            rise = np.where(one, ahead - depth, 0.0) + np.where(two, depth - behind, 0.0)
            slope.append(rise / np.maximum(one.astype(float) + two, 1) / pixel)
        normal = np.stack([-slope[0], -slope[1], np.ones(owner.shape)], axis=-1)
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        for number, faces in self._fixed.items():
            mine = owner == number
            normal[mine] = faces[self._row[part][mine]]
        lit: Array = _AMBIENT + (1.0 - _AMBIENT) * np.clip(normal @ _LIGHT, 0.0, 1.0) * 1.25
        return np.clip(lit, 0.0, 1.12)


def _within(u: Array, v: Array, rectangle: Array) -> Mask:
    """Return which of the places u (n,) across and v (m,) up lie in a rectangle, (m, n)."""
    (a, b), (c, d) = rectangle
    found: Mask = ((v >= c) & (v <= d))[:, None] & ((u >= a) & (u <= b))
    return found


def _shifted(array: NDArray[Any], step: int, axis: int) -> NDArray[Any]:
    """Return an array moved by `step` pixels, the pixels at its border repeated."""
    length = array.shape[axis]
    index = np.clip(np.arange(length) - step, 0, length - 1)
    return np.take(array, index, axis=axis)


def _eroded(mask: Mask, radius: float) -> Mask:
    """Return what of a mask is farther than `radius` pixels from all that is not of it.

    The border of the array counts as not of it.
    """
    reach = math.ceil(radius)
    inside = np.pad(mask, reach + 1)
    far = np.iinfo(np.int32).max // 2
    line = np.arange(inside.shape[0], dtype=np.int32)[:, None]
    last = np.maximum.accumulate(np.where(inside, -far, line), axis=0)
    following = np.minimum.accumulate(np.where(inside, far, line)[::-1], axis=0)[::-1]
    away = np.minimum(np.minimum(line - last, following - line), reach + 1) ** 2
    width = mask.shape[1]
    core = slice(reach + 1, reach + 1 + mask.shape[0])
    kept, limit = mask.copy(), math.floor(radius**2)
    for dx in range(-reach, reach + 1):
        across = away[core, reach + 1 + dx : reach + 1 + dx + width]
        kept &= across > limit - dx * dx
    return kept


def halved(image: Array) -> Array:
    """Return the mean of every two by two pixels, colours weighted by what covers them."""
    height, width = image.shape[0] // 2 * 2, image.shape[1] // 2 * 2
    blocks = image[:height, :width].reshape(height // 2, 2, width // 2, 2, 4)
    cover = blocks[..., 3:]
    colour = (blocks[..., :3] * cover).sum(axis=(1, 3)) / np.maximum(cover.sum(axis=(1, 3)), 1e-9)
    found: Array = np.clip(np.concatenate([colour, cover.mean(axis=(1, 3))], axis=-1), 0.0, 1.0)
    return found
