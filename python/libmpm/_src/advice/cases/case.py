"""What a reference case is: a scene, what is measured in it, what the result must lie within."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from libmpm._src.base.values import nearest, shown
from libmpm._src.boundaries.responses import DecayLayer, Response
from libmpm._src.errors import ModelWarning, SceneError
from libmpm._src.methods.method import FBar, Method
from libmpm._src.run.simulation import Simulation
from libmpm._src.scene.scene import Scene

__all__ = ["Bound", "Case", "CaseResult", "Options"]


@dataclass(frozen=True)
class Bound:
    """Range in which a measured value must lie; `source` says where it comes from."""

    lower: float
    upper: float
    unit: str
    source: str

    def holds(self, value: float) -> bool:
        """Return whether a value lies within; False for NaN."""
        return self.lower <= value <= self.upper


@dataclass(frozen=True)
class Options:
    """Numerical choices that every case can be run with; None or "case" is the case's own choice.

    `method` replaces the case's `Method` but for what the case must prescribe (its docstring says
    so); `fbar` is that of its fluids, `solid_fbar` that of its solids. `walls` is what the walls of
    "tank", "vortex", "gate", "slot" and both surges do, `layer` the decay layer of the bed of
    "slope-basin".
    """

    method: Method | None = None
    fbar: FBar | Literal["case"] | None = "case"
    solid_fbar: FBar | Literal["case"] | None = "case"
    walls: Response | None = None
    layer: DecayLayer | None = None


@dataclass(frozen=True)
class Case:
    """A reference case.

    `build(parameters, options)` gives the scene; `measure(simulation, parameters)` advances it to
    the case's end and returns the values by name. `levels` are the parameters of each size:
    "reduced" takes seconds on two cores, "full" minutes on a GPU. Every bound names a value.
    """

    name: str
    title: str
    source: str
    levels: Mapping[str, Mapping[str, Any]]
    bounds: Mapping[str, Mapping[str, Bound]]  # by level, then by value
    build: Callable[[Mapping[str, Any], Options], Scene]
    measure: Callable[[Simulation, Mapping[str, Any]], dict[str, float]]

    def parameters(self, level: str, changes: Mapping[str, Any]) -> dict[str, Any]:
        """Return the parameters of a level with some of them changed."""
        if level not in self.levels:
            raise SceneError(
                f"case '{self.name}': level is {shown(level)}; {nearest(level, self.levels)}"
            )
        own = dict(self.levels[level])
        unknown = [k for k in changes if k not in own]
        if unknown:
            raise SceneError(
                f"case '{self.name}': unknown parameter '{unknown[0]}'; {nearest(unknown[0], own)}"
            )
        return own | dict(changes)

    def run(
        self,
        level: str = "reduced",
        options: Options | None = None,
        *,
        device: str | Sequence[str] = "cpu",
        precision: str = "auto",
        pipeline: str = "auto",
        threads: int = 0,
        simulate: Callable[..., Simulation] = Simulation,
        **changes: Any,
    ) -> CaseResult:
        """Run it and compare. `changes` replace parameters of the level.

        `simulate` makes the simulation from the scene and the four arguments before it: a subclass
        that reports, for instance.

        Bounds belong to the level as it is: with changed parameters the values are returned and
        compared all the same.
        """
        parameters = self.parameters(level, changes)
        scene = self.build(parameters, options or Options())
        with warnings.catch_warnings():
            # What the scene is doubtful about is the case's own doing.
            warnings.simplefilter("ignore", ModelWarning)
            simulation = simulate(
                scene, device=device, precision=precision, pipeline=pipeline, threads=threads
            )
        began = time.perf_counter()
        values = self.measure(simulation, parameters)
        wall = time.perf_counter() - began
        plan = simulation.plan
        return CaseResult(
            case=self.name,
            level=level,
            parameters=parameters,
            values=values,
            bounds=dict(self.bounds.get(level, {})),
            wall_s=wall,
            simulated_s=simulation.time,
            steps=simulation.steps,
            particles=plan.particles,
            bytes_per_particle={b.name: plan.bytes_per_particle(b.name) for b in scene.bodies},
            bytes_per_node=plan.bytes_per_node,
        )


@dataclass(frozen=True)
class CaseResult:
    """What a run of a case gave."""

    case: str
    level: str
    parameters: Mapping[str, Any]
    values: Mapping[str, float]
    bounds: Mapping[str, Bound]
    wall_s: float
    simulated_s: float
    steps: int
    particles: int
    bytes_per_particle: Mapping[str, int]  # by body
    bytes_per_node: int
    failures: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        """List what lies outside its bound."""
        bad = []
        for name, bound in self.bounds.items():
            value = self.values[name]
            if not bound.holds(value):
                bad.append(
                    f"{self.case} ({self.level}): {name} is {value:.6g} {bound.unit}; expected "
                    f"{bound.lower:.6g} to {bound.upper:.6g} ({bound.source})"
                )
        object.__setattr__(self, "failures", tuple(bad))
