"""`Running`: what views, sensors, guards, writers and pictures need of a running simulation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from libmpm._src.output.series import Series
from libmpm._src.output.settings import Output
from libmpm._src.run.shared_ranks import SharedRanks
from libmpm._src.scene.data import SceneData

__all__ = ["Particles", "Running", "SensorSeries"]


class Particles(Protocol):
    """The particles of one body, as `views.BodyView` shows them."""

    name: str

    @property
    def names(self) -> list[str]:
        """Every attribute that is stored or can be derived."""
        ...

    def __len__(self) -> int:
        """Return the number of particles."""
        ...

    def __getitem__(self, name: str, /) -> NDArray[Any]:
        """Return one attribute, rows sorted by id."""
        ...

    def read(self, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Return several attributes, gathered in one pass."""
        ...

    def refusal(self, name: str) -> str | None:
        """Return why an attribute cannot be read, None if it can."""
        ...


class SensorSeries(Protocol):
    """The series of a run, as `views.SensorsView` shows them."""

    def all_series(self) -> list[Series]:
        """Return the series in the scene's order, then those of inflows and outflows."""
        ...


class Running(Protocol):
    """A simulation, seen from what reads it; `Simulation` is one."""

    @property
    def scene(self) -> SceneData:
        """The scene that runs."""
        ...

    @property
    def dimension(self) -> int:
        """Number of axes."""
        ...

    @property
    def engine(self) -> Any:
        """The compiled engine, made when first asked for."""
        ...

    @property
    def particles(self) -> Mapping[str, Particles]:
        """Body name -> particles."""
        ...

    @property
    def sensors(self) -> SensorSeries:
        """The series of sensors."""
        ...

    @property
    def offset(self) -> NDArray[np.float64]:
        """World position of the domain's lower corner, m, (dimension,)."""
        ...

    @property
    def time(self) -> float:
        """Simulated time, s."""
        ...

    @property
    def steps(self) -> int:
        """Steps done since the scene's start."""
        ...

    @property
    def first_step(self) -> int:
        """Steps at which the scene begins."""
        ...

    @property
    def dt(self) -> float:
        """The time step, s."""
        ...

    @property
    def device(self) -> str:
        """The device in use."""
        ...

    @property
    def precision(self) -> str:
        """Either "single", "mixed" or "double"."""
        ...

    @property
    def pipeline(self) -> str:
        """The pipeline in use."""
        ...

    @property
    def version(self) -> str:
        """Version of libmpm."""
        ...

    @property
    def plan(self) -> object:
        """What it stores, runs and costs; written to a file as text."""
        ...

    @property
    def output(self) -> Output | None:
        """The output settings."""
        ...

    @property
    def displaced(self) -> dict[str, int]:
        """Particles of restored bodies whose place new bodies have taken."""
        ...

    @property
    def particle_steps_per_s(self) -> float:
        """Particles times steps per second in the engine."""
        ...

    @property
    def _shared(self) -> SharedRanks:
        """The ranks that share the scene."""
        ...

    @property
    def inflow(self) -> Mapping[str, Series]:
        """Name of an `Inflow` -> what it has supplied."""
        ...

    def paused(self) -> AbstractContextManager[None]:
        """Hold it at the boundary of a step."""
        ...

    def particle_count(self, body: int) -> int:
        """Return the number of particles of body number `body`."""
        ...

    def totals(self) -> list[int]:
        """Return the number of particles of each body, on all ranks."""
        ...

    def series(self) -> list[Series]:
        """Return the series of all sensors in the scene's order."""
        ...

    def flow_series(self) -> list[Series]:
        """Return the series of all inflows and outflows."""
        ...

    def set_initial(self, body: str, name: str, array: Any) -> None:
        """Give the particles of a body their own velocity or pressure at the start."""
        ...

    def scene_document(self) -> dict[str, Any]:
        """Return the scene file of this run."""
        ...

    def save_checkpoint(self, path: str | Path) -> None:
        """Write the whole state to a file."""
        ...
