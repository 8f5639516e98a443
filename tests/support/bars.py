"""Elastic bars in one dimension: a row of particles in the spans between nodes, held across."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import libmpm
from libmpm import boundaries, materials, shapes
from libmpm._src.methods.transfer import Kernel
from libmpm._src.run.engine_spec import lower

LENGTH, AREA = 1.6, 1.0  # m, m²
YOUNG, DENSITY = 1.2e6, 3000.0  # Pa, kg/m³: waves run at 20 m/s
SPEED = np.sqrt(YOUNG / DENSITY)


class Bar:
    """A bar with a force along it (Yang 2016, 3.6): held at x = 0, or free with two loads.

    (a) held, load q everywhere: at rest σ = q (L - x). (b) `free`, load from -q at x = 0 to q at
    x = L: at rest σ = q x (L - x) / L.
    """

    def __init__(
        self,
        folder: Path,
        cells: int,
        *,
        load: float,
        courant: float,
        smoothing: libmpm.methods.Smoothing | None = None,
        strain: Any = None,
        damping: float = 0.0,
        modified: bool = False,
        assumed: libmpm.methods.AssumedFields | None = None,
        per_cell: int = 3,
        free: bool = False,
    ) -> None:
        """`load` q in N/m; `strain` at the start, a function of x, or "static"."""
        self.load, self.free = load, free
        self.size = size = LENGTH / cells
        self.cells = cells
        self.rest = (np.arange(cells * per_cell) + 0.5) * size / per_cell
        # Node i is the centre of cell i: the bar begins at node 4, the span's middle is y = 2 size.
        self.begin = 4.5 * size
        rows = np.column_stack([self.rest + self.begin, np.full(len(self.rest), 2 * size)])
        file = folder / "bar.npy"
        np.save(file, rows)
        method = libmpm.Method(
            transfer="FLIP",
            kernel=Kernel(name="linear", modified=modified),
            time_step=courant * size / SPEED,
        )
        upper = (size * (cells + 9), size * 4)
        pull = load / (DENSITY * AREA)
        ends = (self.begin, self.begin + LENGTH)
        scene = libmpm.Scene(
            dimension=2, cell_size=size, lower=(0.0, 0.0), upper=upper, method=method,
            gravity=(0.0 if free else pull, 0.0),
        )  # fmt: skip
        scene.add_body(
            name="bar",
            shape=shapes.PointFile(file=str(file), volume=LENGTH * size),
            material=materials.LinearElastic(
                density=DENSITY, youngs_modulus=YOUNG, poissons_ratio=0.0
            ),
            smoothing=smoothing,
            damping=damping,
            assumed=assumed,
            force=libmpm.boundaries.PlacedForce(
                axis="x", place=ends, value=((-pull, 0.0), (pull, 0.0))
            )
            if free
            else None,
        )
        still = libmpm.TimeTable((0.0,), ((0.0, 0.0),))
        everywhere = shapes.Box(lower=(0.0, 0.0), upper=upper)
        scene.add_boundary(
            name="across",
            shape=everywhere,
            response=boundaries.Prescribed(components="y"),
            motion=still,
        )
        if not free:
            scene.add_boundary(
                name="end",
                shape=shapes.Box(lower=(0.0, 0.0), upper=(5 * size, upper[1])),
                response=boundaries.Prescribed(components="x"),
                motion=still,
            )
        self.scene = scene
        told = lower(scene, precision="double", threads=1)
        if strain is not None:
            body = told["bodies"][0]
            n = body["count"]
            state = np.zeros((n, 5))  # xx, yy, xy, and the velocity that FLIP stores
            x = body["position"](0, n)[:, 0] - self.begin
            state[:, 0] = self.static(x) / YOUNG if strain == "static" else strain(x)
            body |= {"state": state, "state_width": 5, "ids": np.arange(n, dtype=np.uint32)}
        from libmpm import _core

        self.engine = _core.Engine(told)

    def static(self, x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Stress at rest, Pa."""
        if self.free:
            return self.load * x * (LENGTH - x) / LENGTH
        return self.load * (LENGTH - x)

    def errors(self) -> tuple[float, float]:
        """Worst mean of a span and rms of particles against the stress at rest, in its extreme."""
        extreme = abs(self.load) * LENGTH / (4 if self.free else 1)
        wrong = self.stress() - self.static(self.position())
        worst, rms = abs(self.cell_means(wrong)).max(), np.sqrt(np.mean(wrong**2))
        return worst / extreme, rms / extreme

    def run(self, until: float) -> None:
        """Step until a time, s."""
        found = self.engine.run(-1, until, 1e9)
        if found["reason"] == "fault":
            raise libmpm.NumericalError(found["fault"]["message"])

    def _by_id(self, name: str) -> npt.NDArray[np.float64]:
        return self.engine.attribute(0, name)[np.argsort(self.engine.attribute(0, "id"))]

    def stress(self) -> npt.NDArray[np.float64]:
        """Axial stress of each particle, Pa."""
        return YOUNG * self._by_id("state")[:, 0]

    def position(self) -> npt.NDArray[np.float64]:
        """Of each particle along the bar, m."""
        return self._by_id("position")[:, 0] - self.begin

    def cell_means(self, field: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Mean of a field over the particles of each span."""
        span = np.floor(self.position() / self.size).astype(int)
        _, cell = np.unique(span, return_inverse=True)
        return np.bincount(cell, field) / np.bincount(cell)
