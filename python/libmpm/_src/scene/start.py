"""`Start`: where a scene continues from, a checkpoint of another run."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from libmpm._src.base.declarations import FIXED, given
from libmpm._src.base.file_digest import file_digest
from libmpm._src.base.values import Checker, Value, sequence, shown, value
from libmpm._src.errors import CheckpointError
from libmpm._src.sensors.engine_sensors import Energy, WaveGauge

if TYPE_CHECKING:
    from libmpm._src.scene.data import SceneData
    from libmpm._src.scene.parts import PlacedSensor

__all__ = ["RestoredBody", "Start", "digest_of"]


@value
class RestoredBody(Value):
    """A body of the run before: its ids are first_id ≤ id < first_id + ids.

    {fields}

    Bodies of one number `stored_as` are stored as one in the checkpoint.
    """

    name: str = given("name of the body")
    first_id: int = given("its first particle id", low=0, whole=True)
    ids: int = given("how many ids it has", low=0, whole=True)
    particle_mass: float = given("mass of one of its particles", unit="kg", above=0)
    stored_as: int = given(
        "number under which the checkpoint has it; bodies of one number are stored as one",
        low=0,
        whole=True,
    )

    left: int | None = given(
        "how many of its particles a cut has left, before tiling; None = all: nothing was cut",
        default=None, low=1, whole=True,
    )  # fmt: skip

    def _label(self) -> str:
        return "Start: a body" if not isinstance(self.name, str) else f"Start: body '{self.name}'"

    def _check(self, check: Checker) -> dict[str, Any]:
        return {
            "name": check.text("name", self.name),
            "first_id": check.given("first_id", self),
            "ids": check.given("ids", self),
            "particle_mass": check.given("particle_mass", self),
            "stored_as": check.given("stored_as", self),
            "left": None if self.left is None else check.given("left", self),
        }

    def of_cut(self, start: Start | None, cells: Sequence[int], cell_size: float) -> dict[str, Any]:
        """Return count and bounds in a domain of so many cells of a cut; {} where nothing was cut.

        The body's shape says where it was at its start, which may be outside.
        """
        if start is None or self.left is None:
            return {}
        edges = np.array(cells) * cell_size
        return {
            "count": self.left * start.tiles,
            "bounds": np.array([np.zeros(len(edges)), edges]),
        }


@value
class Start(Value):
    """Where a scene continues from; made by `Scene.from_checkpoint`.

    {fields}
    """

    label: ClassVar[str] = "Start"

    checkpoint: str = given("the file", scales=FIXED)
    digest: str = given("SHA-256 of its content", range="64 digits")
    time: float = given("at which it was written", unit="s", low=0)
    step: int = given("at which it was written", low=0, whole=True)
    bodies: Sequence[RestoredBody] = given(
        "bodies of the run before, in order: the first of the scene"
    )
    boundaries: int = given("how many of the first boundaries are the run's own", low=0, whole=True)
    sensors: int = given("how many of the first sensors are the run's own", low=0, whole=True)
    time_step: float | None = given(
        "what that run was asked for; None = the stable one", default=None, unit="s", above=0
    )
    tiles: int = given(
        "copies of its domain side by side along `axis`", default=1, low=1, whole=True
    )
    axis: str | None = given('"x", "y" or "z"; None where there is one copy', default=None)
    first_cell: Sequence[int] | None = given(
        "cell of the run's domain at the lower corner of what was cut out of it; None = not cut",
        default=None, shape="(2|3,)", unit="cells",
    )  # fmt: skip
    cut_cells: Sequence[int] | None = given(
        "how many cells were cut out along each axis, before tiling; None = not cut",
        default=None, shape="(2|3,)", unit="cells",
    )  # fmt: skip

    def _check(self, check: Checker) -> dict[str, Any]:
        tiles = check.given("tiles", self)
        if tiles > 1 or self.axis is not None:
            check.choice("axis", self.axis, ("x", "y", "z"))
        for name in ("checkpoint", "digest"):
            check.instance(name, getattr(self, name), (str,), "a text")
        bodies = sequence(self.bodies)
        if bodies is None or not all(isinstance(body, RestoredBody) for body in bodies):
            check.fail(f"bodies is {shown(self.bodies)}; expected what Scene.from_checkpoint gives")
            bodies = []
        cut: dict[str, tuple[int, ...] | None] = {}
        for name in ("first_cell", "cut_cells"):
            cells = getattr(self, name)
            cut[name] = None
            if cells is not None:
                lower = int(name == "cut_cells")
                cut[name] = tuple(
                    check.integer(f"{name}[{a}]", n, lower=lower)
                    for a, n in enumerate(sequence(cells) or ())
                )
        if (self.first_cell is None) != (self.cut_cells is None):
            check.fail("first_cell and cut_cells are not both given; expected both, or none")
        step = self.time_step
        if step is not None:
            step = check.given("time_step", self, step)
        return {
            "tiles": tiles,
            "bodies": tuple(bodies),
            "time": check.given("time", self),
            "step": check.given("step", self),
            "boundaries": check.given("boundaries", self),
            "sensors": check.given("sensors", self),
            "time_step": step,
            **cut,
        }

    def restored(self, name: str) -> RestoredBody | None:
        """Return what the run before knew of a body; None of a new one."""
        return next((b for b in self.bodies if b.name == name), None)

    def check_file(self) -> None:
        """Raise `CheckpointError` unless the file is still the one that the scene was made from."""
        found = digest_of(Path(self.checkpoint))
        if found != self.digest:
            raise CheckpointError(
                f"{self.checkpoint} is not the checkpoint that the scene continues from: its "
                f"SHA-256 begins with {found[:12]}, that of the scene with {self.digest[:12]}; "
                "make the scene again with Scene.from_checkpoint"
            )

    def as_it_was(self, scene: SceneData, time_step: float | None) -> bool:
        """Return whether a run can load the checkpoint's state as it is.

        `scene` is what continues from here, `time_step` what its run was asked for, s. With
        contacts bodies have velocities of their own, which the checkpoint has not.
        """
        return (
            self.tiles == 1
            and self.first_cell is None
            and time_step == self.time_step
            and len(scene.bodies) == len(self.bodies)
            and not scene.contacts
            and not self._kept_apart(scene.sensors)
        )

    def _kept_apart(self, sensors: Sequence[PlacedSensor]) -> bool:
        """Return whether a new sensor asks for one of several bodies that were stored as one.

        Alike neighbours are stepped and saved together until a sensor wants one of them alone;
        the run then takes up its particles body by body.
        """
        asked = {
            s.sensor.body
            for s in sensors[self.sensors :]
            if isinstance(s.sensor, Energy | WaveGauge)
        }
        return any(
            one.stored_as == two.stored_as and {one.name, two.name} & asked
            for one, two in itertools.pairwise(self.bodies)
        )


def digest_of(path: Path) -> str:
    """Return the SHA-256 of a file; raises `CheckpointError` if it cannot be read."""
    try:
        return file_digest(path)
    except OSError as error:
        raise CheckpointError(
            f"{path} cannot be read: {error.strerror or error}; give a checkpoint that a run has "
            "written"
        ) from error
