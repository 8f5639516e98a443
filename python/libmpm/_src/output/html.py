"""Tables that notebooks show of scenes, simulations and series.

Nothing is computed for them and no device is asked: a cell that ends with a simulation costs
nothing.
"""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from libmpm._src.base.formulas import Field
from libmpm._src.base.tables import html_table
from libmpm._src.base.time_tables import TimeTable

if TYPE_CHECKING:
    from libmpm._src.output.series import Series
    from libmpm._src.run.running import Running
    from libmpm._src.scene.data import SceneData

__all__ = ["scene_html", "series_html", "series_list_html", "simulation_html"]

#: Rows of a series that are shown from either end, and columns.
_ROWS, _COLUMNS = 3, 8


def _vector(values: Any) -> str:
    if isinstance(values, Field | TimeTable):
        return type(values).__name__
    return "(" + ", ".join(f"{float(x):g}" for x in values) + ")"


def _motion(boundary: Any) -> str:
    found = [type(x).__name__ for x in (boundary.motion, getattr(boundary, "rotation", None)) if x]
    return ", ".join(found) or "at rest"


def _responses(response: Any) -> str:
    if hasattr(response, "items"):
        return ", ".join(f"{face} {type(one).__name__}" for face, one in response.items())
    return type(response).__name__


def scene_html(scene: SceneData) -> str:
    """Return the parts of a scene as tables."""
    cells = " × ".join(map(str, scene.cells))
    head = [
        ("domain", f"{_vector(scene.lower)} to {_vector(scene.upper)} m"),
        ("cells", f"{cells} of {scene.cell_size:g} m" if scene.grid is None else repr(scene.grid)),
        ("gravity", f"{_vector(scene.gravity)} m/s²"),
    ]
    if any(scene.origin):
        head.insert(1, ("origin", f"{_vector(scene.origin)} m"))
    parts = [
        f"<b>Scene {html.escape(scene.name or 'unnamed')}, {scene.dimension}D</b>",
        html_table(head),
    ]
    if scene.bodies:
        parts.append(html_table(
            [(b.name, b.shape, type(b.material).__name__, b.particles_per_cell,
              _vector(b.velocity)) for b in scene.bodies],
            ("body", "shape", "material", "particles per cell", "velocity [m/s]"),
        ))  # fmt: skip
    if scene.boundaries:
        parts.append(html_table(
            [(b.name, b.shape, _responses(b.response), _motion(b)) for b in scene.boundaries],
            ("boundary", "shape", "response", "motion"),
        ))  # fmt: skip
    if getattr(scene, "flows", ()):
        parts.append(html_table([(f.name, f.flow) for f in scene.flows], ("flow", "how")))
    if getattr(scene, "contacts", ()):
        parts.append(html_table(
            [(c.name, " and ".join(c.between), c.law) for c in scene.contacts],
            ("contact", "between", "law"),
        ))  # fmt: skip
    if scene.sensors:
        parts.append(html_table(
            [(s.name, type(s.sensor).__name__, "every step" if s.sensor.interval == 0
              else f"{s.sensor.interval:g}") for s in scene.sensors],
            ("sensor", "kind", "interval [s]"),
        ))  # fmt: skip
    return "".join(parts)


def simulation_html(simulation: Running) -> str:
    """Return where a simulation stands."""
    scene = simulation.scene
    rows = [
        ("time", f"{simulation.time:g} s, step {simulation.steps:,}"),
        ("device", f"{simulation.device}, {simulation.precision} precision"),
        ("domain", f"{' × '.join(map(str, scene.cells))} cells of {scene.cell_size:g} m"),
        ("bodies", ", ".join(b.name for b in scene.bodies)),
    ]
    if simulation.particle_steps_per_s > 0:
        rows.append(("speed", f"{simulation.particle_steps_per_s:.3g} particle-steps/s"))
    if scene.sensors:
        rows.append(("sensors", ", ".join(s.name for s in scene.sensors)))
    if simulation.output is not None:
        rows.append(("output", str(simulation.output.path)))
    return f"<b>Simulation {html.escape(scene.name or 'unnamed')}</b>" + html_table(rows)


def series_html(series: Series) -> str:
    """Return the ends of a series."""
    names = [f"{c} [{u}]" for c, u in zip(series.components, series.units, strict=True)]
    more = len(names) - _COLUMNS
    head = ["time [s]", *names[:_COLUMNS], *([f"… {more} more"] if more > 0 else [])]
    count = len(series)
    time, values = series.since(0)
    shown = range(count) if count <= 2 * _ROWS else [*range(_ROWS), *range(count - _ROWS, count)]
    rows: list[list[str]] = []
    for i in shown:
        if i and rows and i == count - _ROWS and count > 2 * _ROWS:
            rows.append(["…"] * len(head))
        row = [f"{time[i]:.6g}", *(f"{x:.6g}" for x in np.asarray(values[i])[:_COLUMNS])]
        rows.append(row + [""] * (len(head) - len(row)))
    title = f"<b>{html.escape(series.name)}</b>: {count:,} samples"
    return title + html_table(rows, head)


def series_list_html(names: Sequence[str], kinds: Sequence[str]) -> str:
    """Return the sensors of a simulation without asking it for samples."""
    return html_table(list(zip(names, kinds, strict=True)), ("sensor", "kind"))
