"""`Plan`: what a simulation will store, run and cost, before anything is allocated."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from libmpm._src.base.arguments import keywords_only, known, quoted
from libmpm._src.base.tables import html_table, html_warnings, pair_table, text_table
from libmpm._src.base.values import nearest, shown
from libmpm._src.boundaries.flow_layers import flow_rows
from libmpm._src.errors import SceneError
from libmpm._src.run import backends
from libmpm._src.run.choices import check_backend, choose_device, choose_precision
from libmpm._src.run.engine_spec import lower
from libmpm._src.scene import checks, places
from libmpm._src.scene.checks_elements import faint_strains
from libmpm._src.scene.checks_sizes import check_sweeps
from libmpm._src.scene.checks_time_steps import (
    duration,
    faster_than_flow,
    faster_than_water,
    many_steps,
    shorter_than_step,
)
from libmpm._src.scene.contact_fields import contact_rows, field_of_bodies, has_fields

if TYPE_CHECKING:
    from libmpm._src.scene.data import SceneData

__all__ = ["RATES", "Plan", "build_plan"]

#: Particle-steps per second behind the cost estimate: CPU per core, CUDA per device, measured in 3D
#: with 8 particles per cell and F-bar; CUDA on an H200 with eight million particles (a million
#: reach seven tenths of it). `libmpm bench` measures a machine's own.
RATES = {
    ("cpu", "single"): 1.6e7,
    ("cpu", "double"): 1.05e7,
    ("cuda", "single"): 1.0e10,
    ("cuda", "mixed"): 3.0e9,
    ("cuda", "double"): 2.8e9,
}

#: The same on grids of functions: quadratic Powell-Sabin splines with a consistent mass, measured
#: with two cores and ten particles a triangle; hardly more cores help the factorisation.
RATE_ON_FUNCTIONS = 5e5


def build_plan(
    scene: SceneData,
    *,
    device: str | Sequence[str] = "auto",
    precision: str = "auto",
    pipeline: str = "auto",
    until: float | None = None,
    time_step: float | None = None,
    threads: int = 0,
    shared_device: bool = False,
    ranks: int | None = None,
) -> Plan:
    """Return the plan of a scene; the device need not exist on this machine.

    Of several devices it is that of all on the first. `ranks`: how many share the scene; None = as
    many as `device` names.

    Raises `SceneError`, warns as `Scene.validate`.
    """
    precision = choose_precision(scene, precision)
    kind, index = backends.parse_device(choose_device(scene, device))
    check_backend(kind, precision)
    spec = lower(
        scene,
        precision=precision,
        pipeline=pipeline,
        device_index=index,
        threads=threads,
        shared_device=shared_device,
        time_step=time_step,
        with_particles=False,
    )
    name = "cpu" if kind == "cpu" else f"cuda:{index}"
    result = backends.core().plan(spec, kind)
    if problems := check_sweeps(scene, float(result["time_step"])):
        raise SceneError(problems)
    return Plan(
        result,
        scene=scene,
        device=name,
        precision=precision,
        until=until,
        threads=threads,
        ranks=ranks or (1 if isinstance(device, str) else len(device)),
    )


class Plan:
    """What a simulation stores, runs and costs.

    Prints as a page in a terminal and as tables in Jupyter; `to_dict` gives plain values. SI
    units, memory in bytes.
    """

    def __init__(
        self,
        result: Mapping[str, Any],
        *,
        scene: SceneData,
        device: str = "cpu",
        precision: str = "single",
        until: float | None = None,
        threads: int = 0,
        ranks: int = 1,
    ) -> None:
        """Wrap the engine's plan of `scene`; `until` in s, ≥ 0, adds steps and cost.

        With several `ranks` memory has a part for particles that change rank.
        """
        if until is not None and not (math.isfinite(until) and until >= 0):
            raise SceneError(
                f"plan: until is {shown(until)}; expected a finite time ≥ 0 s, or None"
            )
        self._result = dict(result)
        self._ranks = ranks
        if ranks > 1:
            moved = _migration(self._result["bodies"])
            self._result["memory"] = {**self._result["memory"], "migration": moved}
            self._result["memory_total"] = self._result["memory_total"] + moved
        self._planes = places.planes(scene)
        self._warnings = [
            *checks.check_scene(scene)[1],
            *faster_than_water(scene),
            *faint_strains(scene, precision),
            *faster_than_flow(scene),
            *shorter_than_step(scene, self.time_step),
        ]
        spacings = {b["name"]: float(b["particle_spacing"]) for b in self._result["bodies"]}
        self._flows = flow_rows(scene, spacings)
        self._contacts = contact_rows(scene)
        self._fields = 1 + max(field_of_bodies(scene)) if has_fields(scene) else 1
        self._scene: dict[str, Any] = {
            "name": scene.name,
            "dimension": scene.dimension,
            "cells": list(scene.cells),
            "cell_size": scene.cell_size,
        }
        if scene.grid is not None:
            self._scene["grid"] = repr(scene.grid)
        self._until = until
        self._device = device
        self._precision = precision
        self._threads = threads
        if until:
            assert self.seconds is not None
            self._warnings += many_steps(until, self.time_step, self.limited_by, self.seconds)

    # What the engine says ------------------------------------------------------------------

    @property
    def device(self) -> str:
        """Device that the plan is for: "cpu" or "cuda:N"."""
        return self._device

    @property
    def precision(self) -> str:
        """Number types: "single", "mixed" (particles double, grid single) or "double"."""
        return self._precision

    @property
    def bodies(self) -> list[str]:
        """Names of the bodies."""
        return [b["name"] for b in self._result["bodies"]]

    @property
    def particles(self) -> int:
        """Number of particles in all bodies."""
        return sum(int(b["particles"]) for b in self._result["bodies"])

    @property
    def elements(self) -> int:
        """Number of finite elements in all bodies."""
        return sum(int(b.get("elements", 0)) for b in self._result["bodies"])

    @keywords_only("Plan.body", 1)
    def body(self, name: str) -> dict[str, Any]:
        """Return the entry of a body.

        Its keys: particles, columns, bytes_per_particle, particle_spacing (m), pipeline ("fused",
        "two-pass" or "phased") and pipeline_reason; of a body of them elements.
        """
        for entry in self._result["bodies"]:
            if known(name, (entry["name"],)):
                return dict(entry)
        raise SceneError(f"plan: body {quoted(name)} is unknown; {nearest(name, self.bodies)}")

    def columns(self, body: str) -> list[str]:
        """Return the names of the columns that the particles of a body store."""
        return [c["name"] for c in self.body(body)["columns"]]

    def bytes_per_particle(self, body: str) -> int:
        """Return the bytes that one particle of a body takes."""
        return int(self.body(body)["bytes_per_particle"])

    @property
    def channels(self) -> list[str]:
        """Names of the quantities that a grid node stores."""
        return list(self._result["grid"]["channels"])

    @property
    def bytes_per_node(self) -> int:
        """Bytes of one grid node."""
        return int(self._result["grid"]["bytes_per_node"])

    @property
    def pipeline(self) -> str:
        """Pipeline of all bodies: "fused", "two-pass", "phased"; "by-body" where they differ."""
        return str(self._result["pipeline"])

    @property
    def pipeline_reason(self) -> str:
        """Why this pipeline was taken; where bodies differ, by body."""
        return str(self._result["pipeline_reason"])

    @property
    def kernels(self) -> list[str]:
        """Names of the kernels in the order in which a step runs them."""
        return list(self._result["kernels"])

    @property
    def time_step(self) -> float:
        """Time step at the start, s."""
        return float(self._result["time_step"])

    @property
    def limited_by(self) -> str:
        """What limits the time step."""
        return str(self._result["limited_by"])

    @property
    def memory(self) -> dict[str, int]:
        """Bytes by use: particles, sort, grid, tables; of several ranks migration."""
        return {k: int(v) for k, v in self._result["memory"].items()}

    @property
    def memory_total(self) -> int:
        """Bytes in all, of all ranks."""
        return int(self._result["memory_total"])

    @property
    def ranks(self) -> int:
        """How many ranks share the scene."""
        return self._ranks

    @property
    def memory_of_rank(self) -> int:
        """Bytes of each rank, or device, while their shares are even.

        A share may be `Partition.rebalance_above` times that; up to all with cuts that are set to
        stay, or by measured time. On top come blocks beside the cuts, which several ranks hold, the
        wider sums of ranks on the CPU, and about 0.2 GB on a device.
        """
        return math.ceil(self.memory_total / self._ranks)

    # What follows from it ------------------------------------------------------------------

    @property
    def boundaries(self) -> list[places.Plane]:
        """Stated and effective plane of every wall and box face."""
        return list(self._planes)

    @property
    def warnings(self) -> list[str]:
        """What the scene's checks doubt; bodies that cost needless steps, and runs of very many."""
        return list(self._warnings)

    @property
    def until(self) -> float | None:
        """Time to which steps and cost are counted, s."""
        return self._until

    @property
    def steps(self) -> int | None:
        """Steps to `until` at this time step; more if flow faster than expected shortens it."""
        if self._until is None:
            return None
        steps = self._until / self.time_step if self.time_step > 0 else math.inf
        if not math.isfinite(steps):
            raise SceneError(
                f"the time step is {self.time_step:g} s, of which {self._until:g} s hold more than "
                "can be counted: waves are too fast for the cells; give softer or denser materials"
            )
        return math.ceil(steps * (1 - 1e-12))

    @property
    def particle_steps(self) -> int | None:
        """Particles times steps to `until`."""
        return None if self.steps is None else self.particles * self.steps

    @property
    def rate(self) -> float:
        """Particle-steps per second assumed for the cost estimate."""
        kind = self._device.partition(":")[0]
        if "grid" in self._scene:
            return RATE_ON_FUNCTIONS
        if kind != "cpu":
            return RATES[kind, self._precision]
        # As many as the engine would take: OMP_NUM_THREADS, or the processors of this process.
        threads = self._threads or int(backends.core().build_info()["threads"])
        return RATES[kind, self._precision] * threads

    @property
    def seconds(self) -> float | None:
        """Estimated wall time to `until`, s; an order of magnitude, from `rate`."""
        return None if self.particle_steps is None else self.particle_steps / self.rate

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain values."""
        return {
            "scene": dict(self._scene),
            "device": self.device,
            "precision": self.precision,
            **self._result,
            "boundaries": [dataclasses.asdict(p) for p in self._planes],
            "warnings": self.warnings,
            "until": self.until,
            "steps": self.steps,
            "particle_steps": self.particle_steps,
            "estimate": {"particle_steps_per_s": self.rate, "seconds": self.seconds},
        } | self._flows_to_dict()

    def _flows_to_dict(self) -> dict[str, Any]:
        """Return what inflows, outflows and contacts do, where there are any."""
        keys = ("name", "face", "does")
        rows = [dict(zip(keys, row, strict=True)) for row in self._flows]
        flows = {"flows": rows} if rows else {}
        head = ("name", "between", "law", "pairs")
        contacts = [dict(zip(head, row, strict=True)) for row in self._contacts]
        return flows | ({"fields": self._fields, "contacts": contacts} if contacts else {})

    # Presentation --------------------------------------------------------------------------

    def _summary(self) -> list[tuple[str, str]]:
        scene = self._scene
        cells = " × ".join(map(str, scene["cells"]))
        rows = [
            ("scene", f"{scene['name'] or 'unnamed'}, {cells} cells of {scene['cell_size']:g} m"),
            ("device", f"{self.device}, {self.precision} precision"),
            ("particles", f"{self.particles:,}"),
            (
                "function" if "grid" in scene else "grid node",
                f"{', '.join(self.channels)}: {self.bytes_per_node} bytes",
            ),
            ("pipeline", f"{self.pipeline} ({self.pipeline_reason})"),
            ("kernels", " → ".join(self.kernels)),
            ("time step", f"{self.time_step:.4g} s, limited by {self.limited_by}"),
        ]
        if self.elements:
            rows.insert(3, ("elements", f"{self.elements:,}, their vertices among the particles"))
        if self._contacts:
            slots = self.memory["grid"] / (64 * self.bytes_per_node)
            text = f"{self._fields} of velocities, in about {slots:,.0f} blocks of one field"
            rows.insert(4, ("fields", text))
        if "grid" in scene:
            rows.insert(1, ("grid", scene["grid"]))
        if self.steps is not None and self.particle_steps is not None:
            assert self.seconds is not None
            rows += [
                ("steps", f"{self.steps:,} to {self.until:g} s"),
                (
                    "cost",
                    f"{self.particle_steps:.3g} particle-steps; estimate {duration(self.seconds)} "
                    f"at {self.rate:.2g} particle-steps/s",
                ),
            ]
        parts = ", ".join(f"{k} {_size(v)}" for k, v in self.memory.items())
        if self._ranks > 1:
            parts = f"{_size(self.memory_of_rank)} on each of {self._ranks} ranks; {parts}"
        rows.append(("memory", f"{_size(self.memory_total)} ({parts})"))
        return rows

    def _tables(self) -> list[tuple[Sequence[str], list[Sequence[str]]]]:
        bodies: list[Sequence[str]] = [
            (
                b["name"],
                f"{int(b['particles']):,}",
                f"{b['particle_spacing']:.4g}",
                str(b["bytes_per_particle"]),
                ", ".join(f"{c['name']} ({c['reals']})" for c in b["columns"]),
            )
            for b in self._result["bodies"]
        ]
        found: list[tuple[Sequence[str], list[Sequence[str]]]] = [
            (("body", "particles", "spacing [m]", "bytes each", "columns (numbers)"), bodies)
        ]
        if self._planes:
            faces: list[Sequence[str]] = [
                (p.boundary, p.face, f"{p.stated:g}", f"{p.effective:g}", f"{p.shift:+.3f}", p.cell)
                for p in self._planes
            ]
            head = ("boundary", "face", "stated [m]", "effective [m]", "shift [cells]", "cells")
            found.append((head, faces))
        if self._flows:
            found.append((("flow", "face", "does"), list(self._flows)))
        if self._contacts:
            found.append((("contact", "between", "law", "pairs"), list(self._contacts)))
        return found

    def __str__(self) -> str:
        """Return the plan as text for a terminal."""
        lines = [pair_table(self._summary(), 10)]
        for head, rows in self._tables():
            lines += ["", text_table([head, *rows], flush="left")]
        if self._warnings:
            lines += ["", *(f"warning: {text}" for text in self._warnings)]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        """Return the plan as tables for Jupyter."""
        parts = [html_table(self._summary())]
        parts += [html_table(rows, head) for head, rows in self._tables()]
        return "".join(parts) + html_warnings(self._warnings)

    def __repr__(self) -> str:
        """Return a line with size and pipeline."""
        return (
            f"<Plan: {self.particles:,} particles, {self.pipeline} on {self.device}, "
            f"{self.precision}, {_size(self.memory_total)}>"
        )


def _migration(bodies: Sequence[Mapping[str, Any]]) -> int:
    """Return the bytes that bodies take beyond one rank's where particles come and go.

    A column that is too short for who comes becomes an eighth longer than needed
    (`Domain::admit`), one after another: the old one is there until the new one is full.
    """
    longer = sum(int(b["particles"]) * int(b["bytes_per_particle"]) / 8 for b in bodies)
    number = max(
        (c["bytes"] / max(c["reals"], 1) for b in bodies for c in b["columns"]), default=0.0
    )
    both = max((int(b["particles"]) for b in bodies), default=0) * number * 9 / 8
    return math.ceil(longer + both)


def _size(number: int) -> str:
    """Return bytes in readable units."""
    amount = float(number)
    for unit in ("bytes", "KiB", "MiB"):
        if amount < 1024:
            return f"{amount:.4g} {unit}"
        amount /= 1024
    return f"{amount:.4g} GiB"
