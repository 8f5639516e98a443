"""`Simulation.assign`, `add_action`, `add_force`: a program that acts on a running simulation."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from libmpm._src.base.arguments import keywords_only, known, nearest, quoted, shown
from libmpm._src.base.arrays import real_array
from libmpm._src.base.schedule import due_index, due_time
from libmpm._src.errors import CheckpointError, Error, SceneError
from libmpm._src.run import backends
from libmpm._src.run.device_arrays import DeviceArrays
from libmpm._src.run.running import Running
from libmpm._src.run.thread_turns import Turns

if TYPE_CHECKING:
    from libmpm._src.run.assembly import Assembly

__all__ = ["Acting", "Actions"]


class _Action:
    """A function that is called again and again, and when it was last."""

    def __init__(self, name: str, interval: float, call: Callable[[float], object]) -> None:
        self.name, self.interval, self.call = name, interval, call
        #: Time of the last call, s; None before the first.
        self.last: float | None = None

    def due(self) -> float:
        """Return the time, s, from which it may be called."""
        if self.last is None:
            return -math.inf
        if self.interval == 0:
            return math.nextafter(self.last, math.inf)
        return due_time(due_index(self.last, self.interval) + 1, self.interval)


class Actions:
    """What acts on one simulation, in the order in which it was added."""

    def __init__(self, run: Running, turns: Turns, assembly: Assembly) -> None:
        """Begin with none."""
        self._run = run
        self._turns = turns
        self._assembly = assembly
        self._all: dict[str, _Action] = {}
        self._busy = False
        #: Of the checkpoint that the simulation continues from: name -> interval and last call, s.
        self.recorded: Mapping[str, Any] = {}

    def add(self, name: str, interval: float, call: Callable[[float], object]) -> None:
        """Add one; `call` is given the time since its last call, s."""
        if not isinstance(name, str) or not name or name in self._all:
            raise Error(
                f"action {shown(name)}: expected a name that no other action of this simulation "
                f"has; there {'are ' + ', '.join(self._all) if self._all else 'is none'}"
            )
        number = isinstance(interval, int | float) and not isinstance(interval, bool)
        if not number or not 0 <= interval < math.inf:
            raise Error(
                f"action '{name}': interval is {shown(interval)}; expected seconds, ≥ 0, where 0 "
                "is every step"
            )
        action = _Action(name, float(interval), call)
        if name in self.recorded:
            was, last = (float(self.recorded[name][key]) for key in ("interval", "last"))
            if was != action.interval:
                raise CheckpointError(
                    f"action '{name}': interval is {interval:g} s, in the run resumed from it was "
                    f"{was:g} s; expected the same; give that, or another name"
                )
            action.last = last
        with self._turns:
            self._all[name] = action

    def require(self) -> None:
        """Refuse to continue without what acted on the run before; raises `CheckpointError`."""
        if self._busy:
            raise Error(
                "the function of an action advances the simulation that calls it; expected it to "
                "read, and to assign"
            )
        missing = [name for name in self.recorded if name not in self._all]
        if missing:
            raise CheckpointError(
                f"the run resumed from had the actions {', '.join(missing)}, which are functions "
                "that no file holds; expected them to act on; add them by the same names "
                "(add_action, add_force) before the first step"
            )

    def limit(self, steps: int) -> int:
        """Return how many of `steps` (-1: no limit) may be done before one is due."""
        return 1 if steps != 0 and any(a.interval == 0 for a in self._all.values()) else steps

    def next_time(self) -> float:
        """Return the time, s, at which one is due next; infinity if none is."""
        return min((a.due() for a in self._all.values() if a.interval > 0), default=math.inf)

    def service(self) -> None:
        """Call what is due at the present time."""
        now = self._run.time
        for action in list(self._all.values()):
            if action.due() > now:
                continue
            self._busy = True
            try:
                action.call(0.0 if action.last is None else now - action.last)
            finally:
                self._busy = False
            action.last = now

    def memory(self) -> dict[str, dict[str, float]]:
        """Return what a resumed run needs, as plain values."""
        called = [a for a in self._all.values() if a.last is not None]
        mine = {a.name: {"interval": a.interval, "last": float(a.last or 0.0)} for a in called}
        return dict(self.recorded) | mine

    # Writing -----------------------------------------------------------------------------------

    def assign(
        self,
        body: str,
        velocity: Any,
        velocity_change: Any,
        pressure: Any,
        stored: Mapping[str, Any] | None,
        ids: Any,
    ) -> None:
        """See `Simulation.assign`."""
        run = self._run
        label = f"particles of body {quoted(body)}"
        names = [b.name for b in run.scene.bodies]
        if not known(body, names):
            raise SceneError(f"{label}: there is no such body; {nearest(body, names)}")
        if self._assembly.measurements.busy:
            raise SceneError(
                f"{label} are assigned by the function of a sensors.Custom while it is asked for "
                "numbers; expected it to read only; assign in an action, Simulation.add_action"
            )
        if velocity is not None and velocity_change is not None:
            raise SceneError(
                f"{label}: both velocity and velocity_change are given; expected one of them"
            )
        if pressure is not None and stored:
            raise SceneError(f"{label}: both pressure and stored are given; expected one of them")
        index = names.index(body)
        present = np.sort(np.asarray(run.particles[body]["id"]))
        rows = present if ids is None else _ids(ids, present, label)
        where = np.searchsorted(present, rows)
        n, d = len(rows), run.dimension
        none = np.empty(0)
        change = none
        if velocity_change is not None:
            change = _numbers(velocity_change, (n, d), f"{label}: velocity_change", "m/s")
        elif velocity is not None:
            wanted = _numbers(velocity, (n, d), f"{label}: velocity", "m/s")
            change = wanted - run.particles[body]["velocity"][where]
        level = none
        if pressure is not None:
            level = _numbers(pressure, (n,), f"{label}: pressure", "Pa")
        state = none
        if stored:
            state = self._with_stored(index, stored, where, label)
        if n == 0 or not (change.size or level.size or state.size):
            return
        self._assembly.engine.assign(index, rows.astype(np.uint64), change, state, level)
        if self._assembly.watch is not None:
            self._assembly.watch.acted()

    def columns(self, index: int) -> dict[str, slice]:
        """Return where a body's material stores each of its quantities."""
        run = self._run
        table = {m["name"]: m for m in backends.core().material_table()}
        entry, found, at = table[run.scene.bodies[index].material.table.name], {}, 0
        for column in entry["columns"]:
            width = int(column["components" if run.dimension == 3 else "components_2d"])
            found[str(column["name"])] = slice(at, at + width)
            at += width
        return found

    def stored(self, body: str) -> dict[str, NDArray[np.float64]]:
        """See `Simulation.stored`."""
        run = self._run
        index = [b.name for b in run.scene.bodies].index(run.particles[body].name)
        read = self._assembly.engine.attributes(index, ["id", "state"])
        state = np.asarray(read["state"])[np.argsort(read["id"], kind="stable")]
        return {name: state[:, part].copy() for name, part in self.columns(index).items()}

    def _with_stored(
        self, index: int, stored: Mapping[str, Any], where: NDArray[Any], label: str
    ) -> NDArray[np.float64]:
        columns = self.columns(index)
        material = self._run.scene.bodies[index].material
        if material.table.stores_volume:
            raise SceneError(
                f"{label}: stored is given, but {material.label} is a fluid; expected pressure, "
                "which sets all volumes that it stores"
            )
        own = self.stored(self._run.scene.bodies[index].name)
        for name, array in stored.items():
            if name not in columns:
                raise SceneError(f"{label}: '{name}' is not stored; {nearest(name, columns)}")
            width = columns[name].stop - columns[name].start
            what = f"{label}: stored '{name}'"
            own[name][where] = _numbers(array, (len(where), width), what, "its unit")
        return np.ascontiguousarray(np.concatenate([own[name][where] for name in columns], axis=1))

    def push(
        self, body: str, function: Callable[[DeviceArrays], ArrayLike], elapsed: float
    ) -> None:
        """Change the velocities of a body by what `function` says, times the time elapsed, s."""
        with DeviceArrays(self._run, body) as arrays:
            given = function(arrays)
        if elapsed == 0 or given is None:
            return
        shape = (self._run.particle_count(list(self._run.particles).index(body)),)
        label = f"the force on body '{body}'"
        force = _numbers(given, (*shape, self._run.dimension), label, "N/kg")
        self.assign(body, None, force * elapsed, None, None, None)


def _numbers(array: Any, shape: tuple[int, ...], what: str, unit: str) -> NDArray[np.float64]:
    """Return rows of finite numbers of a given shape; raises `SceneError`."""
    try:
        values = np.ascontiguousarray(real_array(array, what))
    except (OverflowError, TypeError, ValueError) as error:
        raise SceneError(
            f"{what} is no array of numbers: {error}; expected real numbers in {unit}"
        ) from error
    if values.shape != shape:
        raise SceneError(
            f"{what} has the shape {values.shape}; expected {shape}, a row a particle in the "
            f"order of ids, in {unit}"
        )
    finite = np.isfinite(values)
    if not finite.all():
        row = int(np.argwhere(~finite)[0][0])
        raise SceneError(f"{what}: row {row} is {values[row]}; expected finite numbers")
    return values


def _ids(ids: Any, present: NDArray[Any], label: str) -> NDArray[np.uint64]:
    given = np.asarray(ids)
    if given.ndim != 1 or given.dtype.kind not in "iu":
        raise SceneError(
            f"{label}: ids is {shown(ids)}; expected a list of whole numbers, those of "
            "sim.particles[body]['id']"
        )
    unknown = given[~np.isin(given, present)]
    if len(unknown) or len(np.unique(given)) < len(given):
        which = f"id {unknown[0]} is not there" if len(unknown) else "an id is there twice"
        raise SceneError(f"{label}: {which}; expected ids of its particles, each once")
    return given.astype(np.uint64)


class Acting:
    """What a program may do to a `Simulation` at the boundary of a step."""

    _actions: Actions
    _turns: Turns

    @keywords_only("Simulation.assign", 1)
    def assign(
        self,
        body: str,
        *,
        velocity: ArrayLike | None = None,
        velocity_change: ArrayLike | None = None,
        pressure: ArrayLike | None = None,
        stored: Mapping[str, ArrayLike] | None = None,
        ids: ArrayLike | None = None,
    ) -> None:
        """Give particles of a body other velocities or states, at the boundary of a step.

        Parameters
        ----------
        body
            Name of the body.
        velocity, velocity_change
            (n, dimension), m/s: what they shall have, or what is added to what they have. The
            momentum of the body grows by Σ m Δv to rounding. As with velocities given at the start,
            nodes average over the particles around them.
        pressure
            (n,), Pa, of fluids: sets the volumes that they store.
        stored
            Of solids, by the names of what their material stores (docs/materials.md), each
            (n, components), in its unit; see `stored`.
        ids
            (n,) the particles meant, each once; None: all of the body, in ascending order of ids.

        Arrays are of NumPy or of any library with DLPack. What particles have added to the grid is
        taken out and put in as it is with the new values, so that the coming step has them
        (`include/mpm/solver/domain_assign.hpp`). A checkpoint holds the result, and a resumed run
        has the same bits. Refused where it cannot be exact: bodies that are smoothed over cells, a
        stored state besides F-bar's second volume, several ranks, grids of functions, and a change
        that would take particles through half a cell in the coming step. Raises `SceneError`;
        nothing is changed then. The guard counts energies again afterwards.
        """
        with self._turns:
            self._actions.assign(body, velocity, velocity_change, pressure, stored, ids)

    @keywords_only("Simulation.stored", 1)
    def stored(self, body: str) -> dict[str, NDArray[np.float64]]:
        """Return what the material of a body stores: name -> (n, components), in order of ids."""
        with self._turns:
            return self._actions.stored(body)

    @keywords_only("Simulation.add_action", 2)
    def add_action(self, name: str, function: Callable[[Any], object], *, interval: float) -> None:
        """Call ``function(simulation)`` again and again while the simulation runs.

        At the start, and then at the first boundary of a step at or past each multiple of
        `interval`, s; 0 is every step. It may read, and `assign`; steps are not shortened for it. A
        checkpoint holds when it was last called, and a resumed run asks for it by `name` (a
        `CheckpointError` where it is missing). Raises `Error` for a name that is taken.
        """
        self._actions.add(name, interval, lambda _elapsed: function(self))

    @keywords_only("Simulation.add_force", 3)
    def add_force(
        self,
        name: str,
        body: str,
        function: Callable[[DeviceArrays], ArrayLike],
        *,
        interval: float,
    ) -> None:
        """Let a function say the force on the particles of a body, at a stated rate.

        ``function(arrays)`` gets the body's particles as arrays on the device (`DeviceArrays`, with
        `time`) and returns force over mass, (n, dimension) N/kg, rows in the order of ids, as an
        array of any library with DLPack. Its impulse over the time since the last call, which is
        `interval` s rounded up to whole steps (0: every step), changes velocities at once:
        dv = f dt, the kick of a symplectic Euler step. Choose the interval short beside the times
        in which the force changes. Other words as of `add_action`. Raises `Error`.
        """
        names = list(cast("Any", self).particles)
        if not known(body, names):
            raise SceneError(
                f"force {quoted(name)}: there is no body {quoted(body)}; {nearest(body, names)}"
            )
        actions = self._actions
        actions.add(name, interval, lambda elapsed: actions.push(body, function, elapsed))
