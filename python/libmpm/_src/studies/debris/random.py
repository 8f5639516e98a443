"""Random debris, placed by rejection, Bonus (2023) 10.4.

Everything that decides whether a piece may stay is computed alike on every machine: numbers come
from the words of a bit generator, positions and angles are kept to 1e-9, and a piece must clear
its neighbours by a little more than rounding can change.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from libmpm._src.base.values import Checker, keywords_only, sequence, shown
from libmpm._src.errors import SceneError
from libmpm._src.studies.debris.field import DebrisField, Placement
from libmpm._src.studies.debris.laws import Angles, Stream, UniformAngles, counts_of, span
from libmpm._src.studies.debris.prototype import MOST_PIECES, Piece, Prototype, check_prototypes
from libmpm._src.studies.debris.rectangles import Rectangles, gaps, rounded

__all__ = ["PlacementError", "random"]

_LABEL = "debris.random"

#: Distance in m by which a piece stays clear beyond what is asked for: more than rounding, less
#: than positions are kept to.
_MARGIN = 1e-10
#: Combinations of count, size and porosity rejected before the ranges are called empty.
_SKIPS = 10_000
#: Places looked at together, at first and at most.
_FEW, _MANY = 4, 256


class PlacementError(SceneError):
    """A random field could not be placed; `densest` is the attempt with the most pieces."""

    densest: DebrisField

    def __init__(self, problem: str, densest: DebrisField) -> None:
        """Take the problem and the densest attempt."""
        super().__init__(problem)
        self.densest = densest

    def __reduce__(self) -> tuple[Any, ...]:
        """Keep the attempt when pickled."""
        return type(self), (self.problems[0], self.densest)


@keywords_only("debris.random", 1, method=False)
def random(
    prototypes: Prototype | Sequence[Prototype],
    *,
    count: int | Sequence[int] | None = None,
    footprint: Sequence[float] | None = None,
    side: float | Sequence[float] | None = None,
    porosity: float | Sequence[float] | None = None,
    corner: Sequence[float] = (0.0, 0.0),
    angles: Angles | None = None,
    clearance: float,
    seed: int,
    shares: Sequence[float] | None = None,
    attempts: int = 5000,
    restarts: int = 20,
    samples: int = 1,
) -> DebrisField:
    """Return a field of debris at random places and angles.

    ==========  ====  =====  ==================================================================
    parameter   unit  range  meaning
    ==========  ====  =====  ==================================================================
    prototypes  -     -      one, or several that are mixed
    count       1     ≥ 1    pieces: a number, or (low, high) from which one is drawn
    footprint   m     > 0    (lx, ly) of the rectangle that holds all pieces
    side        m     > 0    L of a square footprint in its place, a number or (low, high)
    porosity    1     0...1  part of the footprint that stays free, a number or (low, high)
    corner      m     (2,)   lower corner of the footprint
    angles      -     -      `UniformAngles` or `SpreadAngles`; None = every angle
    clearance   m     ≥ 0    shortest distance between two pieces; 2 to 4 cells of the grid
    seed        1     ≥ 0    the same seed gives the same field on every machine
    shares      1     ≥ 0    parts of the prototypes, as exact counts; None = equal ones
    attempts    1     ≥ 1    places drawn for one piece before the field is begun again
    restarts    1     ≥ 0    times that it is begun again before the sample is rejected
    samples     1     ≥ 1    samples of count, size, porosity and angles drawn before giving up
    ==========  ====  =====  ==================================================================

    Two of count, size (`footprint` or `side`) and porosity are given, and the third follows:
    count from size and porosity to the nearest piece, the side of a square from count and
    porosity. If all three are given, porosity is a limit: combinations outside of it are skipped
    and counted. All ranges are uniform.

    Algorithm: draw count, size, porosity and law of angles; for each piece draw middle and angle
    uniform until its corners lie in the footprint and it is `clearance` away from all before it.
    Rejection makes count, porosity and angles depend on each other, so `placement` records what
    was rejected. Raises `SceneError`, and `PlacementError` with the densest attempt. Source: Bonus
    (2023) 10.4.
    """
    kinds = check_prototypes(_LABEL, prototypes)
    check = Checker(_LABEL)
    law = UniformAngles() if angles is None else angles
    check.instance("angles", law, (Angles,), "debris.UniformAngles or debris.SpreadAngles")
    seed = check.integer("seed", seed)
    search = _Search(
        kinds=kinds,
        corner=check.vector("corner", corner, lengths=(2,), unit="m"),
        clearance=check.number("clearance", clearance, lower=0, unit="m"),
        attempts=check.integer("attempts", attempts, lower=1),
        restarts=check.integer("restarts", restarts),
    )
    samples = check.integer("samples", samples, lower=1)
    sizes = _Sizes.read(check, kinds, shares, count, footprint, side, porosity)
    check.finish()
    stream = Stream(seed)
    best: tuple[float, DebrisField, int] | None = None
    for _ in range(samples):
        chosen, edges = sizes.draw(stream, search.tally)
        interval = law.draw(stream)
        pieces = search.place(chosen, edges, interval, stream)
        made = Placement(
            kind="random", seed=seed, angles=law, interval=interval, **vars(search.tally)
        )
        found = DebrisField(
            prototypes=kinds,
            pieces=pieces,
            corner=search.corner,
            footprint=edges,
            clearance=search.clearance,
            placement=made,
        )
        if len(pieces) == len(chosen):
            return found
        search.tally.rejected += 1
        share = len(pieces) / len(chosen)
        if best is None or share > best[0]:
            best = share, found, len(chosen)
    assert best is not None
    raise PlacementError(_why(best[1], best[2], search), best[1])


@dataclass
class _Tally:
    """What was drawn and rejected so far; see `Placement`."""

    attempts: int = 0
    outside: int = 0
    too_close: int = 0
    restarts: int = 0
    skipped: int = 0
    rejected: int = 0


@dataclass
class _Sizes:
    """Laws of count, footprint and porosity, of which at least two are given."""

    kinds: tuple[Prototype, ...]
    shares: Sequence[float] | None
    count: tuple[int, int] | None
    footprint: tuple[float, ...] | None
    side: tuple[float, float] | None
    porosity: tuple[float, float] | None

    @classmethod
    def read(
        cls,
        check: Checker,
        kinds: tuple[Prototype, ...],
        shares: Any,
        count: Any,
        footprint: Any,
        side: Any,
        porosity: Any,
    ) -> _Sizes:
        """Check what was given."""
        counts: tuple[int, int] | None = None
        if count is not None:
            ends = sequence(count) or [count, count]
            if len(ends) != 2:
                check.fail(f"count is {shown(count)}; expected a whole number or (low, high)")
                ends = [1, 1]
            if ends[0] is ends[1]:
                ends = [check.integer("count", ends[0], lower=1)] * 2
            low, high = (check.integer("count", n, lower=1) for n in ends)
            if high > MOST_PIECES:
                check.fail(f"count is {high}; expected {MOST_PIECES} pieces at most")
            counts = low, high
            if low > high:
                check.fail(f"count is ({low}, {high}); expected low ≤ high; swap them")
        if footprint is not None:
            footprint = check.vector("footprint", footprint, lengths=(2,), unit="m")
            for a, edge in enumerate(footprint):
                if edge <= 0:
                    check.fail(f"footprint[{a}] is {edge:g}; expected > 0 m")
        if side is not None:
            side = span(check, "side", side, unit="m", lower=0, lower_open=True)
        if porosity is not None:
            porosity = span(check, "porosity", porosity, lower=0, upper=1, upper_open=True)
        if footprint is not None and side is not None:
            check.fail("footprint and side are given; expected one of them")
        sized = footprint is not None or side is not None
        if (counts is not None) + sized + (porosity is not None) < 2:
            check.fail(
                "expected two of count, size (footprint or side) and porosity; the third follows"
            )
        counts_of(_LABEL, shares, len(kinds), 1)
        return cls(kinds, shares, counts, footprint, side, porosity)

    def draw(self, stream: Stream, tally: _Tally) -> tuple[list[int], tuple[float, float]]:
        """Return the prototypes of the pieces, in the order of placing, and the footprint."""
        # A thousand pieces show the mean area to a part that no whole number of pieces sees.
        parts = counts_of(_LABEL, self.shares, len(self.kinds), 1000)
        mean = sum(n * k.plan_area for n, k in zip(parts, self.kinds, strict=True)) / 1000
        for _ in range(_SKIPS):
            count = None if self.count is None else stream.integer(*self.count)
            edges = self.footprint
            if self.side is not None:
                edges = (stream.uniform(*self.side),) * 2
            free = 0.0
            if self.porosity is not None and (count is None or edges is None):
                free = stream.uniform(*self.porosity)
            if count is None:
                assert edges is not None
                count = math.floor((1 - free) * math.prod(edges) / mean + 0.5)
            parts = counts_of(_LABEL, self.shares, len(self.kinds), count)
            area = sum(n * k.plan_area for n, k in zip(parts, self.kinds, strict=True))
            if edges is None:
                edges = (math.sqrt(area / (1 - free)),) * 2
            lx, ly = rounded(edges).tolist()
            if count > 0 and self._allowed(1 - area / (lx * ly)):
                kinds = [k for k, n in enumerate(parts) for _ in range(n)]
                return stream.shuffle(kinds), (lx, ly)
            tally.skipped += 1
        raise SceneError(
            f"{_LABEL}: {count} pieces cover {area:.4g} m² of a footprint of {lx * ly:.4g} m², the "
            f"last of {_SKIPS} combinations of count {self.count}, footprint "
            f"{self.footprint or self.side} m and porosity {self.porosity}, which all cover more "
            "than there is or another part of it; expected some that fit; give fewer pieces, a "
            "larger footprint or a wider porosity"
        )

    def _allowed(self, free: float) -> bool:
        """Say whether a combination may be used that leaves this part of the footprint free."""
        sized = self.footprint is not None or self.side is not None
        if self.porosity is None or self.count is None or not sized:
            return free >= 0
        return self.porosity[0] <= free <= self.porosity[1]


@dataclass
class _Search:
    """The search for places, and what it counts."""

    kinds: tuple[Prototype, ...]
    corner: tuple[float, ...]
    clearance: float
    attempts: int
    restarts: int
    tally: _Tally = field(default_factory=_Tally)

    def place(
        self,
        chosen: list[int],
        edges: tuple[float, float],
        interval: tuple[float, float],
        stream: Stream,
    ) -> list[Piece]:
        """Return the pieces of the first complete attempt, or else of the one with the most."""
        best: list[Piece] = []
        for restart in range(self.restarts + 1):
            self.tally.restarts += restart > 0
            pieces = self._attempt(chosen, edges, interval, stream)
            if len(pieces) > len(best):
                best = pieces
            if len(best) == len(chosen):
                break
        return best

    def _attempt(
        self,
        chosen: list[int],
        edges: tuple[float, float],
        interval: tuple[float, float],
        stream: Stream,
    ) -> list[Piece]:
        low = np.array([*self.corner, interval[0]])
        width = np.array([*edges, interval[1] - interval[0]])
        placed = np.empty((len(chosen), 5))
        pieces: list[Piece] = []
        for i, k in enumerate(chosen):
            kind = self.kinds[k]
            left, many = self.attempts, _FEW
            while left > 0 and len(pieces) == i:
                n = min(left, many)
                here = rounded(low + stream.peek(3 * n).reshape(n, 3) * width)
                size = np.broadcast_to([kind.length, kind.width], (n, 2))
                rows = np.hstack([here, size])
                inside, clear = self._tests(Rectangles(*rows.T), Rectangles(*placed[:i].T), width)
                good = np.flatnonzero(inside & clear)
                used = int(good[0]) + 1 if len(good) else n
                self.tally.attempts += used
                self.tally.outside += int(np.sum(~inside[:used]))
                self.tally.too_close += int(np.sum((inside & ~clear)[:used]))
                stream.drop(3 * used)
                left, many = left - used, min(2 * many, _MANY)
                if len(good):
                    placed[i] = rows[good[0]]
                    x, y, angle = here[good[0]].tolist()
                    pieces.append(Piece(prototype=k, x=x, y=y, angle=angle))
            if len(pieces) == i:
                break
        return pieces

    def _tests(
        self, candidates: Rectangles, placed: Rectangles, width: npt.NDArray[np.float64]
    ) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
        """Return which candidates lie in the footprint, and which of those keep the clearance."""
        corners = candidates.corners()
        low = np.array(self.corner) + _MARGIN
        high = np.array(self.corner) + width[:2] - _MARGIN
        within = (corners >= low) & (corners <= high)
        inside = np.asarray(within.all(axis=(1, 2)), dtype=np.bool_)
        clear = np.zeros(len(candidates), dtype=bool)
        nearest = gaps(candidates[inside], placed).min(axis=1, initial=np.inf)
        clear[inside] = nearest >= self.clearance + _MARGIN
        return inside, clear


def _why(densest: DebrisField, wanted: int, search: _Search) -> str:
    """Return why no field could be placed, and what to do."""
    tally = search.tally
    size = " × ".join(f"{edge:g}" for edge in densest.footprint)
    total = math.prod(densest.footprint)
    free = 1 - sum(densest.prototypes[p.prototype].plan_area for p in densest.pieces) / total
    return (
        f"{_LABEL}: {wanted} pieces with a clearance of {search.clearance:g} m could not be placed "
        f"in a footprint of {size} m. Of {tally.attempts} places drawn, up to {search.attempts} "
        f"for a piece, {tally.outside} were outside and {tally.too_close} too close (restarts: "
        f"{tally.restarts}, samples: {tally.rejected}). The densest attempt, `densest` of this "
        f"error, has {len(densest)} of {wanted} pieces and a porosity of "
        f"{free:.3g}. Use fewer pieces, a larger footprint, a smaller clearance, angles that "
        "differ less, more attempts or restarts, or debris.ordered"
    )
