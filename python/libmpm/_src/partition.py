"""How ranks share the blocks of a scene; `design/ranks.md` says what they are."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from libmpm._src.errors import SceneError
from libmpm._src.values import Checker, Value, nearest, shown, value

if TYPE_CHECKING:
    from libmpm._src.backends import Backend

__all__ = ["Partition", "as_partition", "recorded_partition", "told_ranks"]

_AXES = ("x", "y", "z")
#: What the engine calls cuts along the curve.
_CURVE = -1


@value
class Partition(Value):
    """How several ranks share a scene: in which order its blocks are cut, and when anew.

    ===============  ====  =========  ==============================================================
    parameter        unit  range      meaning
    ===============  ====  =========  ==============================================================
    cuts             -     see below  "x", "y" or "z": planes across that axis; "curve": pieces of a
                                      Hilbert curve; None = planes across the longest axis of the
                                      domain if, at the start, they cut through fewer faces of
                                      blocks and are as even as the curve or `rebalance_above`;
                                      else the curve
    rebalance_above  1     0, or ≥ 1  largest load of a rank over the mean one, above which a sort
                                      cuts anew where that makes it 3 % less or better; 0 = at every
                                      sort, at any price; None = never
    ===============  ====  =========  ==============================================================

    Blocks are of 64 cells; a load is particles, and 16 for each block that has some. Cuts lie
    between blocks, so that the loads are even; they have no say in the bits of a run. With `cuts`
    and `rebalance_above` both None planes are taken however uneven they are. Raises `SceneError`.
    """

    label: ClassVar[str] = "Partition"

    cuts: Literal["x", "y", "z", "curve"] | None = None
    rebalance_above: float | None = 1.05

    def _check(self, check: Checker) -> dict[str, Any]:
        found: dict[str, Any] = {}
        if self.cuts is not None:
            choices = (*_AXES, "curve")
            if not isinstance(self.cuts, str) or self.cuts not in choices:
                check.fail(
                    f"cuts is {shown(self.cuts)}; expected an axis, 'x', 'y' or 'z', to cut across "
                    f"by planes, 'curve', or None to have it chosen; {nearest(self.cuts, choices)}"
                )
        if self.rebalance_above is not None:
            # An open end is null in files, so both ways to say "never" are one.
            limit = check.number("rebalance_above", self.rebalance_above, lower=0, infinite=True)
            if 0 < limit < 1:
                check.fail(
                    f"rebalance_above is {limit:g}, and the largest load is never below the mean; "
                    "expected ≥ 1, or 0; use 1 for new cuts whenever they help, 0 for new ones at "
                    "every sort"
                )
            found["rebalance_above"] = None if math.isinf(limit) else limit
        return found

    def check_dimension(self, dimension: int) -> None:
        """Refuse planes across an axis that a scene does not have; raises `SceneError`."""
        if self.cuts in _AXES[dimension:]:
            axes = " or ".join(f"'{name}'" for name in _AXES[:dimension])
            raise SceneError(
                f"Partition: cuts is '{self.cuts}' in a scene of {dimension} dimensions; expected "
                f"an axis that it has; use {axes}, 'curve' or None"
            )

    def specification(self) -> dict[str, Any]:
        """Return what the engine is told."""
        limit = math.inf if self.rebalance_above is None else self.rebalance_above
        told: dict[str, Any] = {"rebalance_above": limit}
        if self.cuts is not None:
            told["axis"] = _CURVE if self.cuts == "curve" else _AXES.index(self.cuts)
        return told


def as_partition(given: Any, backend: Backend, dimension: int) -> Partition | None:
    """Return the partition that an argument of a simulation is; raises `SceneError`.

    One process of ranks as processes may be alone, by the number that its launcher was given; one
    device is the word of the scene's user.
    """
    if given is None:
        return None
    check = Checker("Simulation")
    check.instance("partition", given, (Partition,), "Partition(...), or None for the usual one")
    if not check.problems and backend.ranks == 1 and backend.link is None:
        check.fail(
            f"partition is {given!r} on one device, '{backend.name}'; it says how several ranks "
            f"share a scene; name several, such as device={[backend.name] * 2}, or leave it out"
        )
    check.finish()
    assert isinstance(given, Partition)
    given.check_dimension(dimension)
    return given


def recorded_partition(header: dict[str, Any], backend: Backend) -> Partition | None:
    """Return the partition of the run that wrote a checkpoint; None where one rank goes on."""
    recorded = header.get("partition")
    if recorded is None or (backend.ranks == 1 and backend.link is None):
        return None
    partition = Partition.from_dict(recorded)
    assert isinstance(partition, Partition)
    return partition


def told_ranks(backend: Backend, partition: Partition | None) -> dict[str, Any]:
    """Return what the engine is told about its ranks: nothing where there is one."""
    if backend.ranks == 1:
        return {}
    told: dict[str, Any] = {"count": backend.ranks}
    if backend.link is not None:
        told["processes"] = backend.link.process
    if backend.indices:
        told["devices"] = list(backend.indices)
    return {"ranks": told | ({} if partition is None else partition.specification())}
