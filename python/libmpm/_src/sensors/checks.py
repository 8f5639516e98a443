"""Rules about sensors that are evaluated in Python, in the scene that has them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from libmpm._src.base.values import Checker, nearest
from libmpm._src.scene.places import initial_gravity, vertical_axis
from libmpm._src.sensors import attributes
from libmpm._src.sensors.column_gauge import ColumnGauge
from libmpm._src.sensors.python_sensors import (
    AttributeTracker,
    BodyTracker,
    ContactForce,
    ElevationGauge,
    GridSensor,
    ParticleSensor,
    PressureProbe,
    Sampled,
)
from libmpm._src.sensors.sampler import bodies_of
from libmpm._src.sensors.step_readings import SPREADS

if TYPE_CHECKING:
    from libmpm._src.scene.data import SceneData

__all__ = ["check_sampled"]


def check_sampled(
    check: Checker, scene: SceneData, sensor: Sampled, counts: Mapping[str, int]
) -> None:
    """Report what is wrong with a sensor to `check`; `counts` are particles by body, if known."""
    d = scene.dimension
    body = getattr(sensor, "body", None)
    names = [b.name for b in scene.bodies]
    if body is not None and body not in names:
        check.fail(f"body '{body}' is unknown; {nearest(body, names)}")
        return
    region = getattr(sensor, "region", None)
    if region is not None and region.dimension != d:
        check.fail(f"region has {region.dimension} dimensions; expected {d}, those of the scene")
    direction = getattr(sensor, "direction", None)
    if direction is not None and direction[0] not in "xyz"[:d]:
        check.fail(f"direction is '{direction}' in 2D; expected x or y; use another axis")
    if isinstance(sensor, ParticleSensor):
        _check_direction(check, sensor)
        _check_attribute(check, scene, sensor.attribute, sensor.body)
    elif isinstance(sensor, AttributeTracker):
        for name in sensor.attributes:
            _check_attribute(check, scene, name, sensor.body)
            if attributes.of_elements(name):
                check.fail(
                    f"attributes has '{name}', which has a row for each element and not for each "
                    "particle; expected attributes of vertices; use ParticleSensor with a region"
                )
        _check_ids(check, sensor, counts)
    elif isinstance(sensor, GridSensor):
        _check_grid(check, scene, sensor)
    elif isinstance(sensor, BodyTracker) and "boundary_force" in sensor.quantities:
        _check_loads(check, scene, "boundary_force is asked for")
        if scene.grid is None:
            kernel = scene.method.kernel_choice
            if kernel.name not in SPREADS or kernel.boundary:
                check.fail(
                    f"boundary_force is asked for with {kernel.text()}; a body's share of a node "
                    "is worked out from the places of its particles, without their shapes and "
                    "without ends of the domain; use a kernel 'linear', 'quadratic', 'cubic' or "
                    "'ddmp' without boundary, or leave it out"
                )
    elif isinstance(sensor, ContactForce):
        _check_contact(check, scene, sensor)
    elif isinstance(sensor, PressureProbe):
        _check_place(check, scene, sensor.position, list(range(d)), "the probe")
    elif isinstance(sensor, ElevationGauge | ColumnGauge):
        axis = vertical_axis(scene)
        if sensor.position is not None:
            level = [a for a in range(d) if a != axis]
            _check_place(check, scene, sensor.position, level, "the gauge")
        if (initial_gravity(scene) != 0).sum() > 1:
            check.fail(
                "gravity is not along an axis; expected one axis to be vertical; use "
                'ParticleSensor(attribute="Elevation") with a region'
            )


def _check_contact(check: Checker, scene: SceneData, sensor: ContactForce) -> None:
    names = [b.name for b in scene.bodies]
    if sensor.by not in names:
        check.fail(f"by is unknown body '{sensor.by}'; {nearest(sensor.by, names)}")
    elif sensor.by == sensor.body:
        check.fail(f"by is '{sensor.by}', the body itself; expected another body")
    kernel, transfer = scene.method.kernel_choice, scene.transfer
    plain = kernel.name == "quadratic" and not kernel.boundary and kernel.form == "mls"
    if scene.grid is not None or transfer.scheme != "APIC" or not plain:
        what = "a grid of functions" if scene.grid is not None else (
            f"transfer '{transfer.scheme}' and {kernel.text()}")  # fmt: skip
        check.fail(
            f"ContactForce is asked for with {what}; what bodies leave at the nodes is worked out "
            "for APIC on quadratic splines; expected these; use LoadCell or BodyTracker"
        )


def _check_direction(check: Checker, sensor: ParticleSensor) -> None:
    if sensor.direction is not None and sensor.attribute not in attributes.VECTORS:
        check.fail(
            f"direction is '{sensor.direction}' of '{sensor.attribute}', which is a single number; "
            f"expected it with {' or '.join(attributes.VECTORS)}; leave it out"
        )


def _check_attribute(check: Checker, scene: SceneData, name: str, body: str | None) -> None:
    for i in bodies_of(scene, body):
        problem = attributes.refusal(name, scene.bodies[i], scene)
        if problem is not None:
            check.fail(problem)
            return  # the message names every body that has it


def _check_ids(check: Checker, sensor: AttributeTracker, counts: Mapping[str, int]) -> None:
    if sensor.body not in counts:
        return
    first = 0
    for name, n in counts.items():
        if name == sensor.body:
            break
        first += n
    last = first + counts[sensor.body] - 1
    wrong = [i for i in sensor.ids if not first <= i <= last]
    if wrong:
        check.fail(
            f"ids has {', '.join(map(str, wrong[:5]))}; expected ids of body '{sensor.body}', "
            f"{first} to {last}"
        )


def _check_loads(check: Checker, scene: SceneData, what: str) -> None:
    """Refuse forces of boundaries where the grid does not tell them."""
    if scene.grid is not None:
        check.fail(f"{what} on a grid of functions; expected square cells; use a LoadCell")
        return
    scheme = scene.transfer.scheme
    if scheme in ("XPIC", "FMPM"):
        check.fail(
            f"{what} with {scheme}, which changes the grid between forces and boundaries; expected "
            "another transfer; use a LoadCell"
        )


def _check_grid(check: Checker, scene: SceneData, sensor: GridSensor) -> None:
    if scene.grid is not None:
        check.fail(
            "a grid of functions has no nodes that carry mass of their own; expected square or "
            "cubic cells; use a ParticleSensor, or a LoadCell for forces"
        )
    elif sensor.attribute == "force":
        _check_loads(check, scene, "attribute is 'force'")
    elif sensor.attribute == "volume_energy" and not any(
        b.material.table.stores_volume for b in scene.bodies
    ):
        check.fail(
            "attribute is 'volume_energy' and no body is a fluid; expected a body of TaitFluid or "
            "HerschelBulkleyFluid; use Energy for solids"
        )


def _check_place(
    check: Checker, scene: SceneData, place: object, axes: list[int], what: str
) -> None:
    point = [float(x) for x in place]  # type: ignore[attr-defined]
    if len(point) != len(axes):
        check.fail(
            f"position has {len(point)} numbers; expected {len(axes)}, for axes "
            f"{', '.join(map(str, axes))}; correct it"
        )
        return
    for a, x in zip(axes, point, strict=True):
        if not scene.lower[a] - 1e-9 <= x <= scene.upper[a] + 1e-9:
            check.fail(
                f"{what} is at {x:g} m on axis {a}; expected inside the domain, "
                f"{scene.lower[a]:g} to {scene.upper[a]:g} m; move it or enlarge the domain"
            )
