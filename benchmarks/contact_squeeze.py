"""A soft block between two stiff ones: how deep its edges enter these, by what it has lost.

The scene is that of the axis "contact, squeezed" (`extremes_contact.squeezed`); depths are those
that a guard sees (`Guard(overlap=...)`), which is switched off here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from extremes_contact import DENSITY, YOUNG, squeezed

import libmpm
from libmpm import materials
from libmpm._src.run.guard_overlap import deepest_entry

#: Parts of the height that are lost, between faces without friction.
PARTS = (0.1, 0.3, 0.5, 0.6, 0.65, 0.7, 0.77, 0.8, 0.83)
#: What else is tried, at 0.5 and 0.8.
OTHER: dict[str, dict[str, Any]] = {
    "friction 0.3": {"static": 0.3},
    "friction 1": {"static": 1.0},
    "24 x 16 cells": {"fine": 2},
    "cfl 0.1": {"cfl": 0.1},
    "Poisson 0.3": {"poissons_ratio": 0.3},
}

#: Moments at which a run is looked at.
LOOKS = 40


def deepest(part: float, poissons_ratio: float = 0.0, **more: Any) -> dict[str, float]:
    """Return how deep the middle of a particle lies in the other body at most, cells.

    Of all looks, and in the last one; beside it the least mean volume ratio of the soft block. A
    run that ends with an error has what there was before.
    """
    trial = squeezed(part, **more)
    if poissons_ratio:
        soft = materials.NeoHookean(
            density=DENSITY, youngs_modulus=YOUNG, poissons_ratio=poissons_ratio
        )
        trial.scene.replace("soft", material=soft)
    simulation = libmpm.Simulation(
        trial.scene, device="cpu", precision="double", guard=libmpm.Guard(overlap=None)
    )
    found: list[tuple[float, float]] = []
    for look in range(1, LOOKS + 1):
        try:
            simulation.run(until=trial.until * look / LOOKS, progress=False)
        except libmpm.NumericalError:
            break
        found.append((_depth(simulation), _ratio(simulation)))
    depths, ratios = np.array(found).T
    return {
        "deepest": float(depths.max()), "last": float(depths[-1]), "ratio": float(ratios.min()),
        "whole": float(len(found) == LOOKS),
    }  # fmt: skip


def _ratio(simulation: libmpm.Simulation) -> float:
    return float(np.mean(simulation.particles["soft"]["volume_ratio"]))


def _depth(simulation: libmpm.Simulation) -> float:
    dx, d = simulation.scene.cell_size, simulation.scene.dimension
    read = {b.name: simulation.particles[b.name].read(["position", "volume"])
            for b in simulation.scene.bodies}  # fmt: skip

    def of(one: str, other: str) -> float:
        x, y = (np.asarray(read[name]["position"]) / dx for name in (one, other))
        return deepest_entry(x, y, np.asarray(read[other]["volume"]) / dx**d)[0]

    return max(max(of("soft", other), of(other, "soft")) for other in ("below", "above"))


def rows() -> Iterator[tuple[str, Callable[[], dict[str, float]]]]:
    """Yield a row for each part, then for each other way."""
    for part in PARTS:
        yield f"{part:g} lost", lambda part=part: deepest(part)
    for name, more in OTHER.items():
        for part in (0.5, 0.8):
            yield f"{part:g} lost, {name}", lambda part=part, more=more: deepest(part, **more)
