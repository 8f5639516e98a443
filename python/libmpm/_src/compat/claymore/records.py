"""What a ClaymoreUW scene says, in one dialect: plain records in SI units, axes as in the file."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

__all__ = ["BodyRecord", "BoundaryRecord", "GeometryRecord", "SceneRecord", "SensorRecord"]

Vector = tuple[float, ...]
Counts = tuple[int, int, int]
Pairs = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class GeometryRecord:
    """A geometry of a body: an object, and what it does to the body so far."""

    path: str
    object: str
    operation: str
    span: Vector
    offset: Vector
    rotate: Vector
    fulcrum: Vector
    array: Counts
    spacing: Vector
    radius: float
    axis: str
    bathymetry: Pairs
    level: float | None
    file: str | None
    scaling: float
    attributes: bool


@dataclass(frozen=True)
class BodyRecord:
    """A body: a law with its numbers, numerical choices, and geometries in order.

    `numbers` are those of the material, by their names in the file; `fbar` is None without
    volume smoothing, else the share ψ, and `split` asks for it in a pass of its own.
    """

    path: str
    name: str
    law: str
    numbers: dict[str, float]
    ppc: float
    cfl: float
    velocity: Vector
    alpha: float
    beta: tuple[float, float]
    fbar: float | None
    split: bool
    geometry: tuple[GeometryRecord, ...]
    output: tuple[str, ...]
    tracked: tuple[int, ...]
    tracks: tuple[str, ...]
    partition: tuple[Vector, Vector] | None

    def same_as(self, other: BodyRecord) -> bool:
        """Return whether the two differ in nothing but name, place in the file and partition."""
        here = replace(self, path="", name="", partition=None, geometry=())
        there = replace(other, path="", name="", partition=None, geometry=())
        mine, its = ([replace(g, path="") for g in one.geometry] for one in (self, other))
        return here == there and mine == its


@dataclass(frozen=True)
class BoundaryRecord:
    """A boundary: an object, how it touches, where, and how it moves."""

    path: str
    name: str
    object: str
    contact: str
    friction: tuple[float, float]
    lower: Vector | None
    upper: Vector | None
    array: Counts
    spacing: Vector
    time: tuple[float, float] | None
    velocity: Vector | None
    file: str | None
    bathymetry: Pairs
    axis: str | None
    radius: float | None


@dataclass(frozen=True)
class SensorRecord:
    """A sensor over grid nodes or particles inside a box."""

    path: str
    name: str
    grid: bool
    attribute: str
    operation: str
    direction: tuple[int, int]
    interval: float
    lower: Vector
    upper: Vector


@dataclass(frozen=True)
class SceneRecord:
    """Everything that a file says."""

    name: str
    domain: Vector
    cell_size: float
    time_step: float | None
    gravity: Vector
    time: float
    frames: int
    fps: int
    length_ratio: float
    cauchy: bool
    bodies: tuple[BodyRecord, ...] = field(default=())
    boundaries: tuple[BoundaryRecord, ...] = field(default=())
    sensors: tuple[SensorRecord, ...] = field(default=())
