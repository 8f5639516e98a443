"""`libmpm run`: runs a scene file to its closing report."""

from __future__ import annotations

import time as clock
from collections.abc import Sequence
from pathlib import Path

from libmpm._src.errors import Error
from libmpm._src.output import report
from libmpm._src.run.partition import Partition
from libmpm._src.run.simulation import Simulation
from libmpm._src.scene.run_file import RunFile

__all__ = ["closing_report", "run_to_end", "start"]


def start(
    source: RunFile,
    folder: Path,
    *,
    device: str | Sequence[str] = "auto",
    precision: str = "single",
    pipeline: str = "auto",
    threads: int = 0,
    overwrite: bool = False,
    guard: bool = True,
    partition: Partition | None = None,
) -> Simulation:
    """Return the simulation of a scene file that writes into `folder`."""
    simulation = Simulation(
        source.scene,
        device=device,
        precision=precision,
        pipeline=pipeline,
        threads=threads,
        guard=guard,
        partition=partition,
        output=source.settings.output(folder, overwrite=overwrite),
    )
    simulation.run_settings = source.settings.to_dict()
    return simulation


def run_to_end(
    simulation: Simulation,
    until: float,
    *,
    progress: bool,
    picture: bool,
    wall_limit: float | None = None,
) -> str:
    """Run to `until` s and return the closing report with the paths of all files.

    A run that is stopped before, after `wall_limit` s or by a signal, says how to continue instead.
    """
    began, first = clock.monotonic(), simulation.steps
    reached = simulation.run(until=until, progress=progress, wall_limit=wall_limit)
    wall, steps = clock.monotonic() - began, simulation.steps - first
    simulation.close()
    if not reached:
        output = simulation.output
        on = "; checkpoint written; continue with: libmpm resume"
        on = "" if output is None else f"{on} {output.path}"
        return (
            f"stopped by {simulation.stopped} at {simulation.time:g} of {until:g} s, step "
            f"{simulation.steps}{on}"
        )
    return closing_report(simulation, wall, steps, picture=picture)


def closing_report(simulation: Simulation, wall: float, steps: int, *, picture: bool) -> str:
    """Return the table and the list of files of a finished run."""
    length = float(simulation.run_settings.get("filter", 0.0))
    loads = report.summaries(simulation.sensors, length)
    lines = ["", report.table(loads, simulation.particle_steps_per_s, wall, steps), ""]
    output = simulation.output
    if output is None:
        return "\n".join(lines)
    folder = output.path
    if picture:
        try:
            lines.append(f"picture  {report.draw(folder, length=length)}")
        except Error as error:
            # The results are there: what is damaged among earlier ones must not fail the run.
            lines.append(f"picture  not drawn: {error}")
    files = len(list((folder / "frames").glob("*.vtkhdf")))
    frames = f"{folder / 'frames'} ({files} files, VTKHDF for ParaView)"
    if not files:
        frames = 'none; "frame_interval" in the "run" key of the scene file asks for them'
    lines += [
        f"sensors  {folder / 'sensors.h5'} (CSV in {folder / 'csv'})",
        f"frames   {frames}",
        f"scene    {folder / 'scene.json'}, plan {folder / 'plan.txt'}",
        f"log      {folder / 'log.json'}",
    ]
    if output.checkpoint_interval:
        lines.append(f"restart  {folder / 'checkpoints'}: libmpm resume {folder}")
    return "\n".join(lines)
