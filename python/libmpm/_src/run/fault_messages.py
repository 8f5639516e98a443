"""Messages for what goes wrong while a simulation runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from libmpm._src.base.text import listed

__all__ = ["describe_fault", "describe_removed", "removed_rows"]

#: Fault code -> (what happened, what to do).
_CAUSES = {
    "non-finite": (
        "the state is no longer finite",
        "lower Method.cfl or the time step, check the material's parameters, or raise the bulk "
        "modulus so that the flow stays below a tenth of the sound speed",
    ),
    "outran-cell": (
        "particles moved more than a cell in one step",
        "lower Method.cfl or the time step; check initial velocities and boundary motion",
    ),
    "inverted": (
        "the deformation gradient is no longer invertible",
        "lower Method.cfl or the time step, use a smaller cell, or a stiffer material",
    ),
    "inverted-element": (
        "an element has turned inside out, or lost all but a twentieth of its volume",
        "lower Method.cfl or the time step, use a stiffer material or longer elements where it is "
        "compressed most; what breaks or flows is for particles",
    ),
    "element-range": (
        "an element has flowed or strained beyond the range of its law",
        "lower Method.cfl or the time step, or use a stiffer material where it flows; what is "
        "stretched many times its length is for particles",
    ),
    "compressed": (
        "the volume fell out of the range of the equation of state",
        "lower Method.cfl or the time step, or raise the bulk modulus",
    ),
    "stretched": (
        "a particle was stretched further than its kernel reaches",
        "use kernel 'ugimp', 'ddmp' or a B-spline, or more particles per cell",
    ),
    "left-domain": (
        "particles left the domain",
        "enlarge the domain, add a wall where it is open, let a moving boundary reach two cells "
        "beyond the walls that it meets, or choose Method(leaving='delete') or, on square cells, "
        "'freeze'",
    ),
    "unstable-step": (
        "the time step has become longer than the longest stable one",
        "lower the time step or leave it out, use more particles per cell, grids.PartialMass() "
        "with an empty row of cells beyond the surface, or LumpedMass()",
    ),
    "starved": (
        "the stable time step has shrunk to nothing",
        "use more particles per cell, grids.PartialMass() with an empty row of cells beyond the "
        "surface, or LumpedMass()",
    ),
    "singular-mass": (
        "the mass matrix could not be solved",
        "use more particles per cell (with quadratic functions 9, with cubic 25 or more), "
        "grids.LumpedMass(), or for ConsistentMass(solver='cg') more iterations",
    ),
    "smoothing-energy": (
        "smoothing over cells has added energy",
        "use another method of Smoothing, and report the scene: no method should",
    ),
    "smoothing-range": (
        "a strain is too large for the sums of smoothing over cells",
        "leave Smoothing out of this body, or run on the CPU, which sums numbers of any size",
    ),
    "crowded-node": (
        "too many bodies meet at a node",
        "use a smaller cell, or let the smallest bodies stick to each other: contacts.Stick()",
    ),
    "fixed-point": (
        "a sum on the grid overflowed its fixed-point number",
        "lower Method.cfl or the time step, or use precision='double'",
    ),
}

#: Share of a cell in a step below which no speed has made a state infinite.
_CALM = 0.1
#: Ids shown in a message; the rest is counted.
_SHOWN = 8


def describe_fault(fault: Mapping[str, Any], time_step: float, cell_size: float = 0.0) -> str:
    """Return body, particles, step, time, onset, and what to lower.

    `cell_size` in m tells whether anything was fast; 0 = it is not known.
    """
    code = str(fault["code"])
    cause, remedy = _CAUSES.get(code, (code, "lower Method.cfl or the time step"))
    speed = fault.get("speed")
    # What becomes unstable is fast before it is no number any more.
    calm = speed is not None and float(speed) * time_step < _CALM * cell_size
    if code == "non-finite" and len(fault["ids"]) and calm:
        remedy = (
            f"no node was faster than {_CALM:g} of a cell in a step, so a shorter step or a "
            "stiffer material is not what is missing: check the material's parameters and the "
            "velocity, stress or pressure that the body starts with, use precision='double', and "
            "report the scene if it stands in double"
        )
    who = f"body '{fault['body']}'" if fault["body"] else "grid"
    if len(fault["ids"]):
        what = "vertices" if code in ("inverted-element", "element-range") else "particle"
        who += f", {what} {listed(fault['ids'], _SHOWN)}"
    text = (
        f"{who}: {cause} at step "
        f"{fault['step']}, {fault['time']:.6g} s (time step {time_step:.4g} s"
    )
    if fault.get("speed"):
        text += f", speed {fault['speed']:.4g} m/s"
    text += ")"
    if fault.get("message"):
        text += f": {fault['message']}"
    grew = fault.get("grew_since")
    if grew is not None and int(grew) >= 0 and code != "left-domain":
        text += f"; speeds have grown since step {int(grew)}"
    return f"{text}. Remedy: {remedy}"


def removed_rows(
    gone: Sequence[tuple[int, Any, Any, int, str]], names: Sequence[str], offset: Any
) -> list[list[Any]]:
    """Return (step, body, id, policy, x, y, z) of every particle that left, in the world, m."""
    return [
        [step, names[body], int(i), policy, *map(float, x)]
        for body, ids, position, step, policy in gone
        for i, x in zip(ids, position + offset, strict=True)
    ]


def describe_removed(
    gone: Sequence[tuple[int, Any, Any, int, str]], names: Sequence[str], log: Path | None
) -> str:
    """Return a line for each body and step in which particles left, with their ids."""
    lines = [
        f"body '{names[body]}', step {step}: {len(ids)} particles left the domain "
        f"(policy {policy}): {listed(ids, _SHOWN)}"
        for body, ids, _, step, policy in gone[:_SHOWN]
    ]
    if len(gone) > _SHOWN:
        lines.append(f"and {len(gone) - _SHOWN} more events")
    if log is not None:
        lines.append(f"all are listed in {log}")
    return "; ".join(lines)
