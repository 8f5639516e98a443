"""`Partition`: how ranks (GPUs, processes) share a scene; `design/ranks.md`."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from libmpm._src.base.axes import AXES
from libmpm._src.base.declarations import given
from libmpm._src.base.values import Checker, Value, nearest, sequence, shown, value
from libmpm._src.errors import SceneError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from libmpm._src.run.backends import Backend
    from libmpm._src.scene.data import SceneData

__all__ = ["Partition", "as_partition", "recorded_partition", "told_ranks"]

_KINDS = ("body", "material")
#: What the engine calls cuts along the curve.
_CURVE = -1


@value
class Partition(Value):
    """How several ranks share a scene: in which order its blocks are cut, where, and when again.

    {fields}

    Blocks are of 64 cells: 8 x 8, or 4 x 4 x 4. Cuts lie between blocks; they have no say in the
    bits of a run. `at` and `by` say where they begin, and again where a run is resumed: they hold
    until a sort moves the cuts to where loads are even, so with `rebalance_above=None` for ever.

    `by` takes as many groups as ranks. A rank has all particles in its blocks, and its blocks are
    one piece of the row that is cut; so cuts are where most particles come to lie with their group.
    Groups beside each other are parted, one inside another is not, and may leave a rank with
    nothing. Ranks take groups in the order in which these lie along the row.

    With `cuts`, `by` and `rebalance_above` all None planes are taken however uneven they are.
    Raises `SceneError`.
    """

    label: ClassVar[str] = "Partition"

    cuts: Literal["x", "y", "z", "curve"] | None = given(
        '"x", "y" or "z": planes across that axis; "curve": pieces of a Hilbert curve; None '
        "= planes across the longest axis of the domain if, at the start, they cut through "
        "fewer faces of blocks and are as even as the curve or `rebalance_above`; else the "
        "curve; with `by` whatever parts the groups best",
        default=None,
    )
    at: Sequence[float] | None = given(
        "places along the axis of `cuts` at which n ranks begin to be cut, ascending and "
        "inside the domain: planes at the borders of blocks nearest to them; None = where "
        "loads are even",
        default=None,
        unit="m",
        shape="(n - 1,)",
    )
    by: Literal["body", "material"] | Sequence[Sequence[str]] | None = given(
        'what begins on a rank of its own: "body", "material" (all bodies of an equal one), '
        'or the names of the bodies of each rank, such as (("water",), ("deck", "pier")); '
        "None = nothing",
        default=None,
    )
    weights: Literal["particles", "measured"] = given(
        '"particles": the load of a block is its particles, and 16 for having any; '
        '"measured": that times what it has cost its rank of late, by the processor time of '
        "its own work (CPU)",
        default="particles",
    )
    rebalance_above: float | None = given(
        "largest load of a rank over the mean one, above which a sort cuts again where that "
        "makes it 3 % less or better; 0 = at every sort, at any price; None = never",
        default=1.05,
        unit="1",
        range="0, or ≥ 1",
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        found: dict[str, Any] = {}
        if self.cuts is not None:
            choices = (*AXES, "curve")
            if not isinstance(self.cuts, str) or self.cuts not in choices:
                check.fail(
                    f"cuts is {shown(self.cuts)}; expected an axis, 'x', 'y' or 'z', to cut across "
                    f"by planes, 'curve', or None to have it chosen; {nearest(self.cuts, choices)}"
                )
        if self.at is not None:
            found["at"] = self._check_at(check)
        if self.by is not None:
            found["by"] = self._check_by(check)
        check.choice("weights", self.weights, ("particles", "measured"))
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

    def _check_at(self, check: Checker) -> tuple[float, ...]:
        """Return the places of planes."""
        given = sequence(self.at)
        if not given:
            check.fail(f"at is {shown(self.at)}; expected places in m, such as (1.5, 3.0), or None")
            return ()
        before = len(check.problems)
        places = tuple(check.number(f"at[{k}]", x, unit="m") for k, x in enumerate(given))
        for k in range(1, len(places)):
            if len(check.problems) == before and not places[k - 1] < places[k]:
                check.fail(
                    f"at[{k}] is {places[k]:g} m behind {places[k - 1]:g} m; expected ascending "
                    "places; put them in order, each once"
                )
        if self.cuts not in AXES:
            check.fail(
                f"at is {shown(places)} and cuts is {shown(self.cuts)}; planes lie across an axis; "
                "use cuts='x', 'y' or 'z', or leave at out"
            )
        if self.by is not None:
            check.fail("at and by both define where ranks begin; expected one; leave the other out")
        return places

    def _check_by(self, check: Checker) -> Any:
        """Return what begins on a rank of its own."""
        if isinstance(self.by, str):
            return check.choice("by", self.by, _KINDS)
        groups = [sequence(group) for group in sequence(self.by) or ()]
        names = [name for group in groups for name in group or (None,)]
        if not names or not all(isinstance(name, str) for name in names):
            check.fail(
                f"by is {shown(self.by)}; expected 'body', 'material', or the names of the bodies "
                "of each rank, such as (('water',), ('deck', 'pier'))"
            )
            return None
        for name in sorted({str(name) for name in names if names.count(name) > 1}):
            check.fail(
                f"by names the body '{name}' {names.count(name)} times; expected once; it can "
                "begin on one rank"
            )
        return tuple(tuple(group or ()) for group in groups)

    def fit(self, scene: SceneData, ranks: int) -> None:
        """Refuse what a scene or the number of its ranks does not have; raises `SceneError`."""
        check = Checker("Partition")
        dimension = scene.dimension
        if self.cuts in AXES[dimension:]:
            axes = " or ".join(f"'{name}'" for name in AXES[:dimension])
            check.fail(
                f"cuts is '{self.cuts}' in a scene of {dimension} dimensions; expected an axis "
                f"that it has; use {axes}, 'curve' or None"
            )
        # One process that its launcher has left alone has nothing to cut.
        elif ranks > 1 and self.at is not None and scene.grid is None:
            self._planes(scene, ranks, check)
        if ranks > 1 and self.by is not None:
            self._groups(scene, ranks, check)
        check.finish()

    def _planes(self, scene: SceneData, ranks: int, check: Checker) -> list[int]:
        """Return the number of the first block behind each plane, along the axis."""
        places = tuple(self.at or ())
        axis = AXES.index(str(self.cuts))
        if len(places) != ranks - 1:
            check.fail(
                f"at has {len(places)} places and there are {ranks} ranks; expected one place "
                f"fewer than ranks; give {ranks - 1}, or leave at out"
            )
            return []
        low, high = scene.lower[axis], scene.upper[axis]
        from libmpm._src.scene.checks_sizes import block_edge  # a description needs no rules

        edge = block_edge(scene.dimension)
        size = edge * scene.cell_size
        last = -(-scene.cells[axis] // edge) - 1
        there = (
            f"borders between blocks lie every {size:g} m from {low + size:g} to "
            f"{low + last * size:g} m"
            if last > 0
            else f"the domain is one block of {size:g} m across"
        )
        found: list[int] = []
        for k, x in enumerate(places):
            if not low < x < high:
                check.fail(
                    f"at[{k}] is {x:g} m and the domain from {low:g} to {high:g} m along "
                    f"'{self.cuts}'; expected a place inside it; {there}"
                )
                continue
            first = math.floor((x - low) / size + 0.5)
            if not 0 < first <= last:
                check.fail(
                    f"at[{k}] is {x:g} m, nearest to an end of the domain, where a rank would "
                    f"have nothing; expected a place nearest to a border between blocks; {there}"
                )
            elif found and first <= found[-1]:
                check.fail(
                    f"at[{k}] is {x:g} m, nearest to the same border between blocks as "
                    f"{places[k - 1]:g} m; expected a block or more for each rank; {there}"
                )
            found.append(first)
        return found

    def _groups(self, scene: SceneData, ranks: int, check: Checker) -> list[int]:
        """Return the group of each body."""
        names = [body.name for body in scene.bodies]
        groups: list[list[str]] = []
        if self.by == "material":
            kinds: list[Any] = []
            for body in scene.bodies:
                if body.material not in kinds:
                    kinds.append(body.material)
                    groups.append([])
                groups[kinds.index(body.material)].append(body.name)
        elif self.by == "body":
            groups = [[name] for name in names]
        else:
            groups = [list(group) for group in self.by or ()]
            for name in (name for group in groups for name in group if name not in names):
                check.fail(f"by names the body '{name}'; {nearest(name, names)}")
            for name in names:
                if not any(name in group for group in groups):
                    check.fail(
                        f"by does not name the body '{name}'; expected all of the scene; add it to "
                        "the group of a rank"
                    )
        if len(groups) != ranks:
            what = f"by='{self.by}'" if isinstance(self.by, str) else "by"
            check.fail(
                f"{what} makes {len(groups)} groups and there are {ranks} ranks; expected one for "
                "each; name the bodies of each rank, such as by=(('water',), ('deck', 'pier'))"
            )
        return [next((k for k, group in enumerate(groups) if name in group), 0) for name in names]

    def specification(self, scene: SceneData, ranks: int) -> dict[str, Any]:
        """Return the engine's specification, for a scene that it fits."""
        limit = math.inf if self.rebalance_above is None else self.rebalance_above
        told: dict[str, Any] = {"rebalance_above": limit}
        if self.cuts is not None:
            told["axis"] = _CURVE if self.cuts == "curve" else AXES.index(self.cuts)
        check = Checker("Partition")
        if self.at is not None:
            told["planes"] = self._planes(scene, ranks, check)
        if self.by is not None:
            told["groups"] = self._groups(scene, ranks, check)
        check.finish()
        return told | {"measured": self.weights == "measured"}


def as_partition(given: Any, backend: Backend, scene: SceneData) -> Partition | None:
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
            f"partition is {shown(given)} on one device, '{backend.name}'; it says how "
            "several ranks "
            f"share a scene; name several, such as device={[backend.name] * 2}, or leave it out"
        )
    check.finish()
    assert isinstance(given, Partition)
    if given.weights == "measured" and backend.kind != "cpu":
        raise SceneError(
            f"Partition: weights is 'measured' on '{backend.name}'; the work of a step is timed on "
            "CPU ranks alone; use weights='particles'"
        )
    given.fit(scene, backend.ranks)
    return given


def recorded_partition(header: dict[str, Any], backend: Backend) -> Partition | None:
    """Return the partition of the run that wrote a checkpoint; None where one rank continues."""
    recorded = header.get("partition")
    if recorded is None or (backend.ranks == 1 and backend.link is None):
        return None
    partition = Partition.from_dict(recorded)
    assert isinstance(partition, Partition)
    return partition


def told_ranks(backend: Backend, partition: Partition | None, scene: SceneData) -> dict[str, Any]:
    """Return the engine's specification of ranks: nothing where there is one."""
    if backend.ranks == 1:
        return {}
    told: dict[str, Any] = {"count": backend.ranks}
    if backend.link is not None:
        told["processes"] = backend.link.process
    if backend.indices:
        told["devices"] = list(backend.indices)
    if partition is not None:
        told |= partition.specification(scene, backend.ranks)
    return {"ranks": told}
