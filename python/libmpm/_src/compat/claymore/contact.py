"""What boundaries of ClaymoreUW have in common: contact, time, copies, motion."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from libmpm._src.base.time_tables import constant
from libmpm._src.boundaries.responses import Displacement, Response, Separable, Slip, Sticky, Travel
from libmpm._src.compat.claymore.geometry import Fit, find_file, place_of
from libmpm._src.compat.claymore.motion import read_motion
from libmpm._src.compat.claymore.reader import Context
from libmpm._src.compat.claymore.records import BoundaryRecord
from libmpm._src.shapes.boxes import Box
from libmpm._src.shapes.solid import Solid

__all__ = ["Made", "Setting", "acts_at_start", "boxes", "copies_of", "displacement", "gone"]
__all__ += ["response_of", "surfaces", "wide", "window_of"]


@dataclass(frozen=True)
class Made:
    """A boundary to add: the arguments of `Scene.add_boundary`, and what it blocks at the start.

    A body that reaches into `blocks` also loses what lies in `beyond`. With `solids_only` it acts
    on solid bodies alone.
    """

    name: str
    arguments: dict[str, Any]
    blocks: Solid | None = None
    beyond: Solid | None = None
    solids_only: bool = False


@dataclass(frozen=True)
class Setting:
    """What the boundaries of a file have in common: domain, start and length of the run, s."""

    fit: Fit
    start: float
    until: float
    folder: Path
    gravity: tuple[float, ...]


def response_of(
    context: Context, one: BoundaryRecord, friction: tuple[float, float] | None = None
) -> Response:
    static, dynamic = one.friction if friction is None else friction
    if one.contact != "separable" and max(static, dynamic) > 0:
        context.note(f"{one.path}: friction has no effect with contact '{one.contact}'")
    if one.contact == "sticky":
        return Sticky()
    if one.contact == "slip":
        return Slip()
    if dynamic > static:
        context.note(
            f"{one.path}: friction_static {static:g} is below friction_dynamic {dynamic:g}; both "
            f"are {dynamic:g}"
        )
    return Separable(static_friction=max(static, dynamic), dynamic_friction=dynamic)


def window_of(one: BoundaryRecord, setting: Setting) -> dict[str, Any]:
    """Return the time in which a boundary acts, since the start of the run; {} for always."""
    if one.time is None:
        return {}
    begin, end = (t - setting.start for t in one.time)
    if begin <= 0 and end >= setting.until:
        return {}
    return {"time": (max(0.0, begin), math.inf if end >= setting.until else end)}


def gone(context: Context, one: BoundaryRecord, setting: Setting) -> bool:
    if one.time is not None and one.time[1] <= setting.start:
        context.note(f"{one.path}: its time ends before the run begins; left out")
        return True
    return False


def acts_at_start(one: BoundaryRecord, setting: Setting) -> bool:
    return one.time is None or one.time[0] <= setting.start < one.time[1]


def wide(fit: Fit, lower: Sequence[float], upper: Sequence[float]) -> Box:
    """Return a box that goes on outside the domain where it reaches the domain's edge."""
    low = [fit.beyond(a, x, -1) for a, x in enumerate(lower)]
    high = [fit.beyond(a, x, 1) for a, x in enumerate(upper)]
    return Box(lower=low, upper=high)


def copies_of(one: BoundaryRecord) -> list[tuple[tuple[float, ...], tuple[float, ...]]]:
    """Return the corners of all copies of a boundary."""
    assert one.lower is not None and one.upper is not None
    steps = [[i * s for i in range(n)] for n, s in zip(one.array, one.spacing, strict=True)]
    return [
        (
            tuple(x + v for x, v in zip(one.lower, by, strict=True)),
            tuple(x + v for x, v in zip(one.upper, by, strict=True)),
        )
        for by in itertools.product(*steps)
    ]


def boxes(
    context: Context,
    one: BoundaryRecord,
    setting: Setting,
    name: str,
    corners: Sequence[tuple[Sequence[float], Sequence[float]]],
    friction: tuple[float, float] | None = None,
) -> list[Made]:
    if gone(context, one, setting):
        return []
    fit, made, lost = setting.fit, [], 0
    response = response_of(context, one, friction)
    for lower, upper in corners:
        if any(b <= a for a, b in zip(lower, upper, strict=True)):
            context.fail(one.path, f"spans {list(lower)} to {list(upper)}; expected end > start, m")
            return []
        box = wide(fit, lower, upper)
        if one.file is not None:
            motion = displacement(context, one, setting)
            if motion is None:
                return []
            made.append(_moving(name, box, response, motion, window_of(one, setting)))
            continue
        blocks = place_of(box, fit)
        if blocks is None:
            lost += 1
            continue
        if min(b - a for a, b in zip(box.lower, box.upper, strict=True)) < 0.5 * fit.cell_size:
            context.note(
                f"{one.path}: thinner than a cell of {fit.cell_size:g} m; it blocks one cell"
            )
            box = blocks
        arguments: dict[str, Any] = {"shape": box, "response": response}
        if one.velocity is not None:
            arguments["motion"] = constant(one.velocity)
            context.note(f"{one.path}: velocity is that of its faces; the box stays")
        blocks_now = blocks if acts_at_start(one, setting) else None
        made.append(Made(name, arguments | window_of(one, setting), blocks_now))
    if lost:
        context.note(f"{one.path}: {lost} of {len(corners)} copies lie outside the domain")
    return made


def surfaces(
    context: Context,
    one: BoundaryRecord,
    setting: Setting,
    name: str,
    shapes: Sequence[Solid],
    **arguments: Any,
) -> list[Made]:
    """Return boundaries of any shape, at rest or moved by the file's motion."""
    if gone(context, one, setting):
        return []
    if one.file is not None and "motion" not in arguments:
        motion = displacement(context, one, setting)
        if motion is None:
            return []
        arguments["motion"] = motion
    elif one.velocity is not None and "motion" not in arguments:
        arguments["motion"] = Travel(one.velocity)
    arguments.setdefault("response", response_of(context, one))
    window = window_of(one, setting)
    return [
        Made(name, {"shape": s} | arguments | window, _at_start(s, arguments, one, setting))
        for s in shapes
    ]


def _at_start(
    shape: Solid, arguments: Mapping[str, Any], one: BoundaryRecord, setting: Setting
) -> Solid | None:
    if not acts_at_start(one, setting):
        return None
    motion = arguments.get("motion")
    if isinstance(motion, Displacement):
        return shape.moved(motion.table.at(0.0).tolist())
    return shape


def displacement(context: Context, one: BoundaryRecord, setting: Setting) -> Displacement | None:
    """Return the motion of a boundary's file; None and a problem where there is none."""
    path = find_file(setting.folder, one.file or "")
    if path is None:
        context.fail(
            one.path,
            f"names the motion file '{one.file}', which is not in {setting.folder}; put it there, "
            "or give load(path, motion_folder=...)",
        )
        return None
    table = read_motion(context, one.path, path, setting.start, setting.until)
    return None if table is None else Displacement(table)


def _moving(
    name: str, shape: Solid, response: Response, motion: Displacement, window: dict[str, Any]
) -> Made:
    blocks = shape.moved(motion.table.at(0.0).tolist())
    return Made(name, {"shape": shape, "response": response, "motion": motion} | window, blocks)
