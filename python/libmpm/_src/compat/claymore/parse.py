"""Files of either dialect, and workflow files of HydroUQ, turned into records."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from libmpm._src.base.values import deeper_than, shown
from libmpm._src.compat.claymore.aliases import (
    CONTACTS,
    DIRECTIONS,
    LAWS,
    OBJECTS,
    OPERATIONS,
    REFUSED_LAWS,
    REFUSED_OBJECTS,
    SHAPES,
    STATISTICS,
    fold,
)
from libmpm._src.compat.claymore.reader import Context, Record, pick
from libmpm._src.compat.claymore.records import (
    BodyRecord,
    BoundaryRecord,
    GeometryRecord,
    SceneRecord,
    SensorRecord,
)
from libmpm._src.errors import SceneError

__all__ = ["read_scene"]

_ZERO = (0.0, 0.0, 0.0)

#: Numbers of each law: default, lower end, whether it is left out, upper end, unit.
_E = ("youngs_modulus", 1e7, 0.0, True, math.inf, "Pa")
_NU = ("poisson_ratio", 0.2, -1.0, False, 0.5, "1")
_PHI = ("friction_angle", 30.0, 0.0, False, 89.0, "degrees")
_NUMBERS: Mapping[str, tuple[tuple[str, float, float, bool, float, str], ...]] = {
    "fluid": (
        ("bulk_modulus", 2e7, 0.0, True, math.inf, "Pa"),
        ("gamma", 7.1, 1.0, False, 20.0, "1"),
        ("viscosity", 1e-3, 0.0, False, math.inf, "Pa·s"),
    ),
    "fixed-corotated": (_E, _NU),
    "neo-hookean": (_E, _NU),
    "drucker-prager": (
        _E,
        _NU,
        _PHI,
        ("cohesion", 0.0, 0.0, False, math.inf, "logarithmic strain"),
        ("logJp0", 0.0, -math.inf, False, math.inf, "1"),
        ("beta", 0.5, 0.0, False, 1.0, "1"),
    ),
    "cam-clay": (
        _E,
        _NU,
        _PHI,
        ("logJp0", 0.0, -math.inf, False, math.inf, "1"),
        ("xi", 0.8, 0.0, True, math.inf, "1"),
        ("beta", 0.5, 0.0, False, math.inf, "1"),
    ),
    "von-mises": (
        _E,
        _NU,
        ("tensile_yield_strength", 2e6, 0.0, True, math.inf, "Pa"),
        ("hardening_modulus", 1e6, 0.0, False, math.inf, "Pa"),
    ),
}
_SWITCHES = {"drucker-prager": "SandVolCorrection", "cam-clay": "hardeningOn"}
#: Keys that belong to some law; with another one they have no effect.
_OF_SOME_LAW = {row[0] for rows in _NUMBERS.values() for row in rows} | set(_SWITCHES.values())


#: Lists and objects inside each other; a scene inside a workflow has a dozen.
_DEEPEST = 100


def read_scene(path: Path, context: Context) -> SceneRecord:
    """Read a file; what is wrong with it goes to `context`, and an unreadable one is raised."""
    try:
        data = json.loads(path.read_text(encoding="utf-8-sig"))
    except FileNotFoundError as error:
        raise SceneError(f"{path}: no such file; give the path of a ClaymoreUW scene") from error
    except (OSError, RecursionError, ValueError) as error:
        raise SceneError(f"{path}: cannot be read as JSON: {error}") from error
    if deeper_than(data, _DEEPEST):
        raise SceneError(f"{path}: objects are nested more than {_DEEPEST} deep; expected fewer")
    file = Record(context, _unwrapped(context, data), "", "file")
    record = _scene(context, file, path.stem)
    file.close()
    return record


def _unwrapped(context: Context, data: Any) -> Any:
    """Return the scene inside a workflow file of HydroUQ, or the data themselves."""
    if not isinstance(data, Mapping):
        raise SceneError(f"{context.name}: holds {shown(data, 40)}; expected an object")
    if _has_bodies(data) or "Events" not in data:
        if not _has_bodies(data) and not any(fold(key) == "simulation" for key in data):
            raise SceneError(
                f"{context.name}: has neither bodies, models nor Events; expected a scene of "
                f"ClaymoreUW or a workflow of HydroUQ; its keys are {', '.join(data)}"
            )
        return data
    events = data["Events"] if isinstance(data["Events"], list) else [data["Events"]]
    found = [e for e in events if isinstance(e, Mapping) and _has_bodies(e)]
    if not found:
        raise SceneError(
            f"{context.name}: none of its {len(events)} Events has bodies; expected an event of "
            "HydroUQ's MPM"
        )
    context.ignored += [f"{key}: HydroUQ's own" for key in data if key != "Events"]
    for i, event in enumerate(events):
        if event is not found[0]:
            context.ignored.append(f"Events[{i}]: the scene is Events[{events.index(found[0])}]")
    return found[0]


def _has_bodies(data: Mapping[str, Any]) -> bool:
    return any(fold(key) in ("bodies", "models") for key in data)


def _scene(context: Context, file: Record, name: str) -> SceneRecord:
    sim = file.child("simulation", "simulation") or Record(context, {}, "simulation", "simulation")
    scaling = file.child("scaling", "simulation")
    domain = sim.vector("domain", (1.0, 1.0, 1.0))
    if any(x <= 0 for x in domain):
        context.fail(sim.where("domain"), f"is {list(domain)}; expected > 0 m on every axis")
    cell_size = sim.number("default_dx", 0.1, lower=0, above=True, unit="m")
    ratio = pick([sim, scaling], "number", "froude_scaling", 1.0, lower=0, above=True)
    bulk = pick([sim, scaling], "number", "cauchy_bulk_ratio", 1.0, lower=0, above=True)
    if bulk not in (1.0, ratio):
        context.fail(
            sim.where("cauchy_bulk_ratio"),
            f"is {bulk:g} with froude_scaling {ratio:g}; expected 1 or the same ratio; give "
            "bulk_modulus and youngs_modulus as they shall be, and 1 here",
        )
    frames = sim.integer("frames", 60, lower=1)
    fps = sim.integer("fps", 60, lower=1)
    duration = sim.number("duration", None, lower=0, above=True, unit="s")
    if duration is not None and abs(duration - frames / fps) > 1e-6 * duration:
        context.note(
            f"{sim.where('duration')} is {duration:g} s; frames / fps = {frames / fps:g} s is taken"
        )
    cfl = sim.number("cfl", 0.5, lower=0, above=True, upper=1)
    mirrored = sim.raw("mirror_domain", [])
    if isinstance(mirrored, list) and any(mirrored):
        context.note(
            f"{sim.where('mirror_domain')} is {mirrored}: the domain as it stands is run; a "
            "frictionless wall is the plane of symmetry, and the other half is for pictures"
        )
    if file.children("meshes", "body"):
        context.fail(
            file.where("meshes"),
            "has bodies of finite elements, which are refused; describe them by geometry, or add "
            "them to the scene by shapes.Tetrahedra.read_tables(vertices=, elements=)",
        )
    bodies = [_body(context, body, cfl) for body in file.children("bodies", "body")]
    if not bodies:
        context.fail(file.where("bodies"), "is empty; expected at least one body")
    boundaries = [
        _boundary(context, one) for one in file.children("boundaries", "boundary")
        if _switched_on(context, one)
    ]  # fmt: skip
    sensors = [
        _sensor(context, one, grid)
        for key, grid in (("grid-sensors", True), ("particle-sensors", False))
        for one in file.children(key, "sensor")
        if _switched_on(context, one)
    ]
    record = SceneRecord(
        name=name,
        domain=domain,
        cell_size=cell_size,
        time_step=sim.number("default_dt", None, lower=0, above=True, unit="s"),
        gravity=sim.vector("gravity", (0.0, -9.81, 0.0), unit="m/s²"),
        time=sim.number("time", 0.0, unit="s"),
        frames=frames,
        fps=fps,
        length_ratio=ratio,
        cauchy=bulk != 1.0,
        bodies=tuple(b for b in bodies if b is not None),
        boundaries=tuple(b for b in boundaries if b is not None),
        sensors=tuple(s for s in sensors if s is not None),
    )
    sim.close()
    if scaling is not None:
        scaling.close()
    return record


def _switched_on(context: Context, one: Record) -> bool:
    """Return whether HydroUQ has this part switched on."""
    on = bool(one.boolean("toggle", True))
    if not on:
        context.ignored.append(f"{one.path}: its toggle is false")
    return on


def _tracked(context: Context, body: Record, given: Any) -> list[int]:
    """Return the ids of tracked particles."""
    if not isinstance(given, list):
        return []
    numbers = [i for i in given if isinstance(i, int | float) and not isinstance(i, bool)]
    wrong = [i for i in numbers if not 0 <= i < 1 << 32 or i != int(i)]
    if wrong:
        context.fail(
            f"{body.path}: track_particle_id",
            f"has {shown(wrong[0], 40)}; expected whole numbers from 0; correct the list",
        )
        return []
    return [int(i) for i in numbers]


def _body(context: Context, body: Record, cfl: float) -> BodyRecord | None:
    device = body.child("device", "body")
    output = body.child("output", "output")
    trackers = body.child("trackers", "output")
    material = body.child("material", "material")
    algorithm = body.child("algorithm", "algorithm")
    for place in (body, device):
        if place is not None:
            for key in ("gpu", "model", "device", "partition"):
                place.drop(key, "the plan places the work on devices")
    kind = body.text("type", "particles")
    if fold(kind) not in ("particles", "particle"):
        context.fail(body.where("type"), f"is '{kind}'; only bodies of particles are read")
    own = material or body
    if material is not None and "constitutive" in body and "constitutive" not in material:
        own = body
    law = own.choice("constitutive", "JFluid", LAWS, REFUSED_LAWS)
    if own is not body:
        _agree(context, body, own, law)
    numbers = _material(context, [material, body], law, own.text("constitutive", "JFluid"))
    choices = [algorithm, body, material]
    if pick(choices, "boolean", "use_FEM", False):
        context.fail(body.path, "has use_FEM true, which is refused: meshes are not read from it; "
                     "set it to false for particles, and add the body by "
                     "shapes.Tetrahedra.read_tables(vertices=, elements=)")  # fmt: skip
    share: dict[str, Any] = {"lower": 0, "upper": 1}
    alpha = pick(choices, "number", "ASFLIP_alpha", 0.0, **share)
    low = pick(choices, "number", "ASFLIP_beta_min", 0.0, **share)
    high = pick(choices, "number", "ASFLIP_beta_max", 0.0, **share)
    if low > high:
        context.fail(body.path, f"has ASFLIP_beta_min {low:g} above ASFLIP_beta_max {high:g}")
    if not pick(choices, "boolean", "use_ASFLIP", True):
        alpha = low = high = 0.0
    psi = pick(choices, "number", "FBAR_psi", 0.0, **share)
    fused = pick(choices, "boolean", "FBAR_fused_kernel", True)
    smooth = pick(choices, "boolean", "use_FBAR", True) and psi > 0
    tracks = pick([body, trackers], "raw", "track_particle_id", [])
    ids = _tracked(context, body, tracks)
    partition = (body.vector("partition_start", None), body.vector("partition_end", None))
    record = BodyRecord(
        path=body.path,
        name=body.text("name", ""),
        law=law or "",
        numbers=numbers,
        ppc=pick(choices, "number", "ppc", 8.0, lower=0, above=True),
        cfl=pick([material, body, algorithm], "number", "cfl", cfl, lower=0, above=True, upper=1),
        velocity=body.vector("velocity", _ZERO, unit="m/s"),
        alpha=alpha,
        beta=(low, high),
        fbar=psi if smooth else None,
        split=not fused,
        geometry=tuple(
            g for g in (_geometry(context, g) for g in body.children("geometry", "geometry")) if g
        ),
        output=pick([body, output], "names", "output_attribs", ()),
        tracked=tuple(dict.fromkeys(ids)),
        tracks=pick([body, output, trackers], "names", "track_attribs", ()),
        partition=None if partition[0] is None or partition[1] is None else partition,
    )
    if not record.geometry and not context.problems:
        context.fail(body.path, "has no geometry; expected at least one")
    for part in (algorithm, material, device, output, trackers, body):
        if part is not None:
            part.close()
    return record if law else None


def _agree(context: Context, body: Record, own: Record, law: str | None) -> None:
    """Compare the law that a body repeats beside its material."""
    if "constitutive" in body and LAWS.get(fold(body.text("constitutive", ""))) != law:
        context.fail(
            body.where("constitutive"),
            f"is '{body.text('constitutive', '')}', {own.where('constitutive')} is "
            f"'{own.text('constitutive', '')}'; keep one of them",
        )


def _material(
    context: Context, places: list[Record | None], law: str | None, spelling: str
) -> dict[str, float]:
    """Return the numbers of a law; keys of other laws are listed as without effect."""
    numbers = {"rho": pick(places, "number", "rho", 1000.0, lower=0, above=True, unit="kg/m³")}
    for key, default, lower, above, upper, unit in _NUMBERS.get(law or "", ()):
        rules = {"lower": lower, "above": above, "upper": upper, "unit": unit}
        numbers[key] = pick(places, "number", key, default, **rules)
    if law in _SWITCHES:
        key = _SWITCHES[law]
        numbers[key] = float(pick(places, "boolean", key, True))
    for key in _OF_SOME_LAW - set(numbers):
        for place in places:
            if place is not None and place.part == "material":
                place.drop(key, f"{spelling} has none")
    if numbers.get("poisson_ratio", 0.0) > 0.4999:
        context.note(f"a Poisson's ratio of {numbers['poisson_ratio']:g} is taken as 0.4999, as "
                     "ClaymoreUW does")  # fmt: skip
        numbers["poisson_ratio"] = 0.4999
    return numbers


def _geometry(context: Context, one: Record) -> GeometryRecord | None:
    kind = one.choice("object", "box", SHAPES)
    operation = one.choice("operation", "add", OPERATIONS)
    array, spacing = one.counts("array"), one.vector("spacing", _ZERO)
    rotate, fulcrum = one.vector("rotate", _ZERO, unit="degrees"), one.vector("fulcrum", _ZERO)
    if not one.boolean("apply_array", True):
        if array != (1, 1, 1):
            context.ignored.append(f"{one.where('array')}: apply_array is false")
        array, spacing = (1, 1, 1), _ZERO
    if not one.boolean("apply_rotation", True):
        if any(rotate):
            context.ignored.append(f"{one.where('rotate')}: apply_rotation is false")
        rotate = _ZERO
    radius = one.number("radius", 0.0, lower=0, unit="m")
    axis = one.text("axis", "X").strip().lower()
    if kind == "cylinder" and axis not in ("x", "y", "z"):
        context.fail(one.where("axis"), f"is '{axis}'; expected X, Y or Z")
    if kind in ("cylinder", "sphere") and radius <= 0:
        context.fail(one.path, f"is a {kind} without radius; expected > 0 m")
    span = one.vector("span", None)
    length = one.number("length", None, lower=0, above=True, unit="m")
    if span is None:
        span = [1.0, 1.0, 1.0]
        if kind in ("cylinder", "sphere"):
            span = [2 * radius] * 3
        if kind == "cylinder" and length is not None and axis in "xyz":
            span["xyz".index(axis)] = length
    if any(x <= 0 for x in span) and kind != "file" and kind != "bathymetry":
        context.fail(one.where("span"), f"is {list(span)}; expected > 0 m on every axis")
    for n, s in zip(array, spacing, strict=True):
        # Copies to the other side have a negative one.
        if n > 1 and s == 0:
            context.fail(
                one.where("spacing"),
                f"is {list(spacing)} with array {list(array)}; expected a distance that is not 0 "
                "where there is more than one copy",
            )
            break
    custom = one.boolean("use_custom_bathymetry", kind == "bathymetry")
    bathymetry = one.pairs("bathymetry")
    if (custom or kind == "bathymetry") and len(bathymetry) < 2:
        context.fail(one.path, "has no bathymetry; expected two or more pairs [x, y], m")
    level = one.number("standing_water_level", None, unit="m")
    record = GeometryRecord(
        path=one.path,
        object=kind or "",
        operation=operation or "",
        span=tuple(span),
        offset=one.vector("offset", _ZERO),
        rotate=rotate,
        fulcrum=fulcrum,
        array=array,
        spacing=spacing,
        radius=radius,
        axis=axis,
        bathymetry=bathymetry if custom or kind == "bathymetry" else (),
        level=level,
        file=one.text("file", None),
        scaling=one.number("scaling_factor", 1.0, lower=0, above=True),
        attributes=one.boolean("has_attributes", False),
    )
    for key in ("input_attribs", "use_froude_scaling"):
        one.drop(key, "belongs to checkpoint files")
    one.close()
    return record if kind and operation else None


def _boundary(context: Context, one: Record) -> BoundaryRecord | None:
    kind = one.choice("object", "box", OBJECTS, REFUSED_OBJECTS)
    contact = one.choice("contact", "Sticky", CONTACTS)
    static = one.number("friction_static", 0.0, lower=0)
    dynamic = one.number("friction_dynamic", static, lower=0)
    time = one.vector("time", None, unit="s", lengths=(2, 3))
    if time is not None and time[1] <= time[0]:
        context.fail(one.where("time"), f"is {list(time)}; expected the end after the start, s")
        time = None
    corners = (one.vector("domain_start", None), one.vector("domain_end", None))
    if None in corners and kind in ("walls", "floor", "box", "sphere", "cylinder", "plane",
                                    "velocity", "wasirf-pump", "lwf-paddle"):  # fmt: skip
        context.fail(one.path, "has no domain_start or no domain_end; expected both, m")
    velocity = one.vector("velocity", None, unit="m/s")
    custom = one.boolean("use_custom_bathymetry", kind == "bathymetry")
    bathymetry = one.pairs("bathymetry")
    if custom and len(bathymetry) < 2:
        context.fail(one.path, "has no bathymetry; expected two or more pairs [x, y], m")
    record = BoundaryRecord(
        path=one.path,
        name=one.text("name", ""),
        object=kind or "",
        contact=contact or "",
        friction=(static, dynamic),
        lower=corners[0],
        upper=corners[1],
        array=one.counts("array"),
        spacing=one.vector("spacing", _ZERO),
        time=None if time is None else (time[0], time[1]),
        velocity=velocity if kind == "velocity" or any(velocity or ()) else None,
        file=one.text("file", None),
        bathymetry=bathymetry if custom else (),
        axis=one.text("axis", None),
        radius=one.number("radius", None, lower=0, above=True, unit="m"),
    )
    one.close()
    return record if kind and contact else None


def _sensor(context: Context, one: Record, grid: bool) -> SensorRecord | None:
    attribute = one.text("attribute", "Force" if grid else "Elevation")
    operation = one.choice("operation", "sum" if grid else "max", STATISTICS)
    given = one.text("direction", "X").replace(" ", "").lower()
    direction = DIRECTIONS.get(given)
    if direction is None:
        if grid:
            context.fail(one.where("direction"), f"is '{given}'; expected X, X+, X-, Y, …, Z-")
        direction = (0, 0)
    lower, upper = one.vector("domain_start", None), one.vector("domain_end", None)
    if lower is None or upper is None:
        context.fail(one.path, "has no domain_start or no domain_end; expected both, m")
        lower = upper = _ZERO
    elif any(a > b for a, b in zip(lower, upper, strict=True)):
        context.note(f"{one.path}: spans {list(lower)} to {list(upper)}, from high to low; the "
                     "two are swapped")  # fmt: skip
        corners = list(zip(lower, upper, strict=True))
        lower, upper = tuple(map(min, corners)), tuple(map(max, corners))
    rate = one.number("output_frequency", 60.0, lower=0, above=True, unit="Hz")
    record = SensorRecord(
        path=one.path,
        name=one.text("name", ""),
        grid=grid,
        attribute=attribute,
        operation=operation or "",
        direction=direction,
        interval=1.0 / rate,
        lower=lower,
        upper=upper,
    )
    one.close()
    return record if operation else None
