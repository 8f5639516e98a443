"""What the cases share: numerical choices, and plane scenes in two dimensions or as a slab."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from libmpm._src.advice.cases.case import Options
from libmpm._src.base.time_tables import TimeTable
from libmpm._src.methods.method import FBar, Method
from libmpm._src.methods.transfer import Transfer
from libmpm._src.run.simulation import Simulation
from libmpm._src.scene.scene import Scene
from libmpm._src.shapes.boxes import Box

__all__ = ["Slab", "advance", "energies", "fluid_fbar", "method_of", "rms"]
__all__ += ["solid_choices"]


def method_of(options: Options, cfl: float, flip: float = 0.0) -> Method:
    """Return the method asked for, else the case's own: APIC, or AFLIP with a share `flip`."""
    if options.method is not None:
        return options.method
    return Method(cfl=cfl, transfer=Transfer(scheme="AFLIP", flip=flip) if flip else "APIC")


def fluid_fbar(
    options: Options, own: FBar | Literal["default"] | None = "default"
) -> FBar | Literal["default"] | None:
    """Return the F-bar of the case's fluids."""
    return own if options.fbar == "case" else options.fbar


def solid_choices(options: Options) -> dict[str, Any]:
    """Return what to add to the arguments of a solid body."""
    return {} if options.solid_fbar in ("case", None) else {"fbar": options.solid_fbar}


def rms(values: npt.NDArray[np.float64]) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def advance(simulation: Simulation, times: Iterable[float]) -> Iterator[float]:
    """Run to each of the times in turn and give the one reached, s."""
    for time in times:
        simulation.run(until=float(time), progress=False)
        yield simulation.time


def energies(simulation: Simulation, name: str = "energy") -> dict[str, Any]:
    """Return the columns of an `Energy` sensor and their sum "total", J (J/m in 2D)."""
    series = simulation.sensors[name]
    columns = dict(zip(series.components, np.asarray(series.values).T, strict=True))
    columns["total"] = columns["kinetic"] + columns["elastic"] + columns["potential"]
    return columns


@dataclass(frozen=True)
class Slab:
    """The plane x, y with gravity along -y: in 2D, or as a slab of some thickness along z.

    `thickness` is in m, a whole number of cells; 0 is two-dimensional.
    """

    cell_size: float
    thickness: float = 0.0

    @property
    def dimension(self) -> int:
        """Number of axes."""
        return 3 if self.thickness else 2

    @property
    def per_area(self) -> float:
        """Metres of thickness that forces and energies of the scene belong to."""
        return self.thickness or 1.0

    def vector(self, x: float, y: float, z: float = 0.0) -> tuple[float, ...]:
        """Return a vector of the scene."""
        return (x, y, z)[: self.dimension]

    def lattice(self, x: int, y: int) -> tuple[int, ...]:
        """Return a lattice with some particles on x and y, and two a cell through the slab."""
        return (x, y, round(2 * self.thickness / self.cell_size))[: self.dimension]

    def box(self, lower: tuple[float, float], upper: tuple[float, float]) -> Box:
        """Return a box through the whole thickness."""
        return Box(lower=self.vector(*lower), upper=self.vector(*upper, self.thickness))

    def scene(
        self,
        name: str,
        lower: tuple[float, float],
        upper: tuple[float, float],
        gravity: float | TimeTable,
        method: Method,
    ) -> Scene:
        """Return an empty scene whose domain is a box; a table of gravity has its magnitude."""
        down: tuple[float, ...] | TimeTable
        if isinstance(gravity, TimeTable):
            values = np.asarray(gravity.value, dtype=np.float64)
            down = TimeTable(gravity.time, [self.vector(0.0, -float(g)) for g in values])
        else:
            down = self.vector(0.0, -gravity)
        return Scene(
            name=name,
            dimension=self.dimension,
            cell_size=self.cell_size,
            lower=self.vector(*lower),
            upper=self.vector(*upper, self.thickness),
            gravity=down,
            method=method,
        )

    def faces(self, *faces: str) -> tuple[str, ...]:
        """Return faces of the domain, with both sides of a slab."""
        return (*faces, "z-", "z+") if self.thickness else faces
