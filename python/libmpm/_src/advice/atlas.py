"""The shipped atlas: what numerical choices cost and gain, measured on cases with known answers.

`benchmarks/tradeoff.py write` makes the file; `docs/atlas.md` is its page.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from libmpm._src.errors import Error
from libmpm._src.methods.method import CROSSINGS, FBar
from libmpm._src.methods.transfer import Kernel, Transfer
from libmpm._src.output.reading_files import reading

__all__ = ["BASELINE", "Atlas", "Row", "read_atlas"]

BASELINE = "baseline"
#: Law of the rows that vary anything but the law.
_LAW = "FixedCorotated"
#: Version of the file that this reader knows.
_FORMAT = 1


@dataclass(frozen=True)
class Row:
    """One measurement: a setting on a case. Errors are parts of the case's answer."""

    case: str
    kind: str  # "water" or "solid"
    option: str
    group: str
    choices: Mapping[str, Any]
    changes: Mapping[str, Any]
    errors: Mapping[str, float]
    worst: float | None
    cost: float | None
    dissipates: bool
    device: str
    cells: float
    particles: int
    compression: float | None
    mach: float
    dimension: int

    @property
    def transfer(self) -> Transfer:
        """The transfer, as a value."""
        return Transfer(**self.choices["transfer"])

    @property
    def kernel(self) -> Kernel:
        """The kernel, as a value whose default gradient is left open."""
        given = self.choices["kernel"]
        kernel = Kernel(name=given["name"], boundary=given["boundary"])
        if kernel.form == given["gradient"]:
            return kernel
        return Kernel(name=given["name"], boundary=given["boundary"], gradient=given["gradient"])

    @property
    def per_axis(self) -> int:
        """Particles along an axis of a cell."""
        found: int = max(1, round(self.particles ** (1 / self.dimension)))
        return found

    @property
    def of_law(self) -> bool:
        """Whether it measures another elastic law and not a numerical choice."""
        found: bool = self.choices.get("material", _LAW) != _LAW
        return found

    def fbar(self, of: str, cell_size: float, speed: float | None) -> FBar | None:
        """Return its F-bar of "fbar" (water) or "solid_fbar", for cells in m and waves in m/s."""
        given = self.choices.get(of)
        if given is None:
            return None
        if given["length_cells"] is not None:
            return FBar(form=given["form"], length=given["length_cells"] * cell_size)
        crossings = given["time_crossings"]
        if crossings is None or crossings == CROSSINGS or speed is None:
            return FBar(form=given["form"])
        return FBar(form=given["form"], time=crossings * cell_size / speed)


@dataclass(frozen=True)
class Atlas:
    """All rows, with what they were measured by."""

    version: str
    commit: str
    devices: tuple[str, ...]
    rows: tuple[Row, ...]

    def of(self, device: str) -> dict[str, dict[str, Row]]:
        """Return case -> option -> row of a kind of device, "cpu" or "cuda"."""
        found: dict[str, dict[str, Row]] = {}
        for row in self.rows:
            if row.device == device:
                found.setdefault(row.case, {})[row.option] = row
        return found

    @property
    def laws(self) -> set[str]:
        """Names of the solids in it."""
        return {str(row.choices.get("material", _LAW)) for row in self.rows} | {_LAW}


def _row(line: Mapping[str, Any]) -> Row:
    own = line["range"]
    return Row(
        case=line["case"],
        kind=line["kind"],
        option=line["option"],
        group=line["group"],
        choices=line["choices"],
        changes=line["changes"],
        errors=line["errors"],
        worst=line["worst"],
        cost=line["cost"],
        dissipates=bool(line.get("dissipates")),
        device=line["device_kind"],
        cells=float(own["cells_across"]),
        particles=int(own["particles_per_cell"]),
        compression=own["compression"],
        mach=float(own["mach"] or 0.0),
        dimension=int(own["dimension"]),
    )


def parse(data: Mapping[str, Any]) -> Atlas:
    """Return the atlas of a file's contents; raises `Error`."""
    if data.get("format") != _FORMAT:
        raise Error(
            f"atlas: format is {data.get('format')!r}; expected {_FORMAT}; write it again with "
            "benchmarks/tradeoff.py write"
        )
    lines: Iterable[Mapping[str, Any]] = data["lines"]
    devices = tuple(data["device"])
    rows = tuple(_row(line) for line in lines)
    return Atlas(str(data["library"]), str(data["commit"]), devices, rows)


@functools.cache
def _read(path: str) -> Atlas:
    with reading(Path(path), "atlas", "write it again with benchmarks/tradeoff.py write"):
        return parse(json.loads(Path(path).read_text(encoding="utf-8")))


def read_atlas(path: Path | None = None) -> Atlas:
    """Return the shipped atlas, or that of a file."""
    return _read(str(path or resources.files("libmpm") / "data" / "atlas.json"))
