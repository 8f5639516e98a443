"""What all pictures share: figures that notebooks show, samples of particles, colours."""

from __future__ import annotations

import contextlib
import io
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from libmpm._src.base.axes import AXES
from libmpm._src.base.values import nearest, shown
from libmpm._src.errors import Error
from libmpm._src.output.frames import UNITS
from libmpm._src.pictures.directions import OBLIQUE

__all__ = [
    "MOST",
    "Picture",
    "chosen",
    "colours_of",
    "legend_below",
    "limits_of",
    "note",
    "planes_of",
    "shares",
    "title_of",
]

Array = NDArray[np.float64]

#: Particles that a picture draws at most, unless another number is given.
MOST = 200_000

#: Passes of the layout before the first drawing at most; most rest after three.
_PASSES = 12

#: Width of a character of text of a point, inches.
_CHARACTER = 0.0085

#: The golden ratio's fraction, whose multiples fill the unit interval evenly.
_GOLDEN = 0.6180339887498949

#: Of values beyond these percentiles the colours do not tell: spray would fade everything else.
_PERCENTILES = (0.5, 99.5)


class Picture(Figure):
    """A matplotlib figure that a notebook shows as it is, without pyplot."""

    #: Size, inches, at which the layout is what it will stay; None before it was drawn.
    _settled: tuple[float, ...] | None = None

    def draw(self, renderer: Any) -> None:
        """Draw it; the first time, and at another size, once its layout changes no more.

        A pass of the layout takes the labels for what they are where the axes were before. Axes of
        equal scales are elsewhere after it, and the first picture of a flat scene lost the top of
        its title.
        """
        engine, size = self.get_layout_engine(), tuple(self.get_size_inches())
        if engine is not None and self.axes and size != self._settled:
            with contextlib.suppress(ValueError):  # as matplotlib's own call of it does
                places: Any = np.inf
                for _ in range(_PASSES):
                    before = places
                    engine.execute(self)
                    places = np.array([a.get_position(original=True).bounds for a in self.axes])
                    if np.abs(places - before).max() < 1e-3:
                        break
            self._settled = size
        super().draw(renderer)

    def _repr_png_(self) -> bytes:
        """Return it as PNG."""
        content = io.BytesIO()
        self.savefig(content, format="png", dpi=110)
        return content.getvalue()


def legend_below(picture: Any, handles: Sequence[Any], texts: Sequence[str]) -> None:
    """Add a legend below all panels, in as many columns as the picture is wide for."""
    if not handles:
        return
    size, room = 8.0, float(picture.get_figwidth())
    character = size * _CHARACTER
    texts = [textwrap.fill(text, max(8, int((room - 1.0) / character))) for text in texts]
    longest = max(len(line) for text in texts for line in text.splitlines())
    columns = int(np.clip(room / (character * longest + 0.55), 1, 6))
    picture.legend(
        handles, texts, loc="outside lower center", fontsize=size, ncols=columns, frameon=False
    )


def title_of(picture: Any, parts: Sequence[str], size: float) -> str:
    """Return what is said above a panel, in lines that a picture has room for."""
    width = float(picture.get_figwidth())
    room = width - 1.5 if width > 7.0 else 0.45 * width  # a narrow panel begins in the middle
    wide = max(12, int(room / (size * _CHARACTER)))
    return textwrap.fill(", ".join(part for part in parts if part), wide)


def shares(counts: Sequence[int], most: int) -> list[int]:
    """Return how many particles of each body are drawn: all of the small ones, at most `most`."""
    if isinstance(most, bool) or not isinstance(most, int | np.integer) or most < 1:
        raise Error(f"most is {shown(most)}; expected a whole number of particles ≥ 1")
    left, drawn = int(most), [0] * len(counts)
    order = sorted(range(len(counts)), key=lambda i: counts[i])
    for place, i in enumerate(order):
        drawn[i] = min(counts[i], left // (len(order) - place))
        left -= drawn[i]
    return drawn


def chosen(count: int, most: int) -> NDArray[np.int64]:
    """Return which of `count` particles are drawn, ascending: always the same, at most `most`.

    One of each of `most` equal runs of ids, at a place that varies evenly: every n-th particle
    would draw stripes where particles stand in a lattice.
    """
    if count <= most:
        return np.arange(count)
    if most <= 0:
        return np.empty(0, np.int64)
    k = np.arange(most)
    places = (k + np.modf(k * _GOLDEN)[0]) * (count / most)
    return np.unique(np.minimum(places.astype(np.int64), count - 1))


def note(drawn: int, count: int) -> str:
    """Return what a title says of a picture that leaves particles out; empty where it has all."""
    return "" if drawn == count else f"{drawn:,} of {count:,} particles drawn"


def planes_of(dimension: int, planes: Sequence[str] | str | None, vertical: int) -> list[str]:
    """Return the planes to draw, such as "xz": two axes, the first to the right, or "3d".

    Raises `Error` for names that are no planes of the scene.
    """
    known = [a + b for a in AXES[:dimension] for b in AXES[:dimension] if a != b]
    if dimension == 3:
        known.append(OBLIQUE)
    if planes is None:
        if dimension == 2:
            return ["xy"]
        # The elevation along the first horizontal axis, then the plan.
        flat = [a for a in range(3) if a != vertical]
        return [AXES[flat[0]] + AXES[vertical], AXES[flat[0]] + AXES[flat[1]]]
    wanted = names_of("planes", planes)
    for plane in wanted:
        if plane not in known:
            raise Error(f"planes has {shown(plane)}; {nearest(str(plane), known)}")
    return wanted


def names_of(what: str, given: Any) -> list[str]:
    """Return one name or several as a list; raises `Error` for what is none, or for nothing."""
    if isinstance(given, str):
        return [given]
    try:
        names = list(given)
    except TypeError:
        names = []
    if not names or not all(isinstance(name, str) for name in names):
        raise Error(f"{what} is {shown(given)}; expected a name or several")
    return names


def check_axes(axes: Any) -> None:
    """Refuse what is given to draw into and are no axes of matplotlib."""
    from matplotlib.axes import Axes

    if axes is not None and not isinstance(axes, Axes):
        raise Error(f"axes is {shown(axes)}; expected axes of matplotlib, or None")


def split_name(colour: str) -> tuple[str, tuple[int, ...] | None]:
    """Return the attribute behind a name such as "velocity_x" or "stress_xy", and its component."""
    base, _, axes = colour.rpartition("_")
    if base and axes and all(a in AXES for a in axes) and len(axes) <= 2:
        return base, tuple(AXES.index(a) for a in axes)
    return colour, None


def colours_of(arrays: Mapping[str, NDArray[Any]], colour: str) -> Array:
    """Return the numbers (n,) that colour particles: a component, or the length of a vector."""
    name, component = split_name(colour)
    values = np.asarray(arrays[name])
    if component is None:
        return (
            values
            if values.ndim == 1
            else np.sqrt(np.sum(values**2, axis=tuple(range(1, values.ndim))))
        )
    if values.ndim == 2 and len(component) == 2:  # a tensor of a frame, (n, d * d)
        d = round(np.sqrt(values.shape[1]))
        values = values.reshape(len(values), d, d) if d * d == values.shape[1] else values
    index: Any = (slice(None), *component)
    try:
        return np.asarray(values[index], np.float64)
    except IndexError:
        raise Error(
            f"colour is {shown(colour)}, but {name} has the shape {values.shape}; expected a "
            "component "
            "that it has"
        ) from None


def label_of(colour: str) -> str:
    """Return what a colour bar is titled."""
    name, component = split_name(colour)
    unit = UNITS.get(name, "1")
    text = colour.replace("_", " ")
    if component is None and name in ("velocity", "stress", "deformation_gradient"):
        text = f"|{text}|"
    return f"{text} [{unit}]"


def limits_of(values: Sequence[Array]) -> tuple[float, float]:
    """Return the range of colours that shows all but the outermost half percent at either end."""
    finite = [v[np.isfinite(v)] for v in values]
    whole = np.concatenate(finite) if finite else np.empty(0)
    if not len(whole):
        return 0.0, 1.0
    low, high = (float(x) for x in np.percentile(whole, _PERCENTILES))
    return (low, high) if high > low else (low - 0.5, high + 0.5)


def check_limits(limits: Any) -> tuple[float, float]:
    """Return the ends of a range of colours that a caller gave; raises `Error`."""
    try:
        low, high = (float(x) for x in limits)
    except (OverflowError, TypeError, ValueError):
        low, high = np.nan, np.nan
    if not low < high:
        raise Error(f"limits is {shown(limits)}; expected two finite numbers, the lower first")
    return low, high


def check_cut(dimension: int, cut: Sequence[float] | None) -> list[float] | None:
    """Return the point at which a scene in space is cut; raises `Error` for what is none."""
    if cut is None:
        return None
    try:
        found = [float(x) for x in np.asarray(cut, np.float64).ravel()]
    except (OverflowError, TypeError, ValueError):
        found = []
    if dimension == 2 or len(found) != dimension:
        raise Error(
            f"cut is {shown(found or cut)}; expected a point (3,) of a scene in 3D, in m, or None"
        )
    return found
