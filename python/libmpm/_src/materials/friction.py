"""Cones of friction: by which test of a soil its friction angle is meant."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Literal, get_args

from libmpm._src.base.values import Checker
from libmpm._src.materials.material import Material

__all__ = ["Cone", "FrictionalMaterial", "cone_warning", "triaxial", "with_cones"]

#: Tests of a soil in which a cone can meet Mohr and Coulomb's surface.
Cone = Literal["compression", "extension", "plane-strain"]

#: What files that do not name a cone meant when they were written.
_BEFORE = "compression"


def triaxial(angle: float, cone: Cone, dilatancy: float = 0.0) -> float:
    """Return the angle in triaxial compression of the cone that acts as `angle` in a test, degrees.

    `dilatancy` is the angle ψ in compression that the flow has, degrees. In plane strain the stress
    across the plane follows from the flow: with |s| = 3 α p at yield and α' for the flow, s_zz =
    -α' |s|, so that sin φ = 3 α √((1 - 3/2 α'²) / 2) / (1 - 3/2 α α').
    """
    s = math.sin(math.radians(angle))
    if cone == "compression":
        return angle
    if cone == "extension":
        return math.degrees(math.asin(3.0 * s / (3.0 + 2.0 * s)))
    flow = _slope(dilatancy)
    share = math.sqrt((1.0 - 1.5 * flow * flow) / 2.0)
    return _angle(s / (3.0 * share + 1.5 * flow * s))


def triaxial_dilatancy(angle: float, cone: Cone) -> float:
    """Return the dilatancy angle in compression of a flow that dilates by `angle` in a test.

    In plane strain sin ψ = -(ε₁ + ε₃) / (ε₁ - ε₃), and so α' = √2 sin ψ / √(9 + 3 sin² ψ).
    """
    if cone != "plane-strain":
        return triaxial(angle, cone)
    s = math.sin(math.radians(angle))
    return _angle(math.sqrt(2.0) * s / math.sqrt(9.0 + 3.0 * s * s))


def _slope(angle: float) -> float:
    """Return α of the cone through the corners in triaxial compression."""
    s = math.sin(math.radians(angle))
    return math.sqrt(2.0 / 3.0) * 2.0 * s / (3.0 - s)


def _angle(slope: float) -> float:
    """Return the angle of which `_slope` gives α, degrees."""
    part = slope * math.sqrt(1.5)
    return math.degrees(math.asin(3.0 * part / (2.0 + part)))


class FrictionalMaterial(Material):
    """Base of materials with a friction angle, whose core knows that in triaxial compression."""

    friction_angle: float
    cone: Cone | None

    def _check(self, check: Checker) -> dict[str, Any]:
        found = super()._check(check)
        if self.cone is not None:
            found["cone"] = check.choice("cone", self.cone, get_args(Cone))
        return found

    def cone_in(self, dimension: int) -> Cone:
        """Return the cone in a scene of 2 or 3 dimensions, the named one if there is one."""
        if self.cone is not None:
            return self.cone
        return "plane-strain" if dimension == 2 else "compression"

    def core_parameters(self, dimension: int) -> dict[str, float]:
        """Return what the compiled core takes, with angles as in triaxial compression.

        A cohesion keeps the apex of the cone, c cot φ; without friction it is c in the named test.
        """
        found = self.parameters()
        cone = self.cone_in(dimension)
        if cone == "compression":
            return found
        angle, flow = found["friction_angle"], 0.0
        if "dilatancy_angle" in found:
            flow = triaxial_dilatancy(found["dilatancy_angle"], cone)
            found["dilatancy_angle"] = flow
        found["friction_angle"] = triaxial(angle, cone, flow)
        if "cohesion" in found:
            found["cohesion"] *= _cohesion(angle, found["friction_angle"], cone, flow)
        return found


def _cohesion(angle: float, core: float, cone: Cone, dilatancy: float) -> float:
    """Return the cohesion in compression of the cone, in parts of that in a test.

    Mean tension is c cot φ at the apex of each; where φ = 0 the ratio of the slopes is its limit.
    """
    tiny = 1e-4
    if angle < tiny:
        angle, core = tiny, triaxial(tiny, cone, dilatancy)
    return math.tan(math.radians(core)) / math.tan(math.radians(angle))


def with_cones(scene: Mapping[str, Any]) -> dict[str, Any]:
    """Return a scene as written before cones had names, with the one that it meant."""
    given = scene.get("bodies", ())
    if not isinstance(given, list | tuple):  # as the scene's own reader will say
        return dict(scene)
    bodies = []
    for body in given:
        if _unnamed(body):
            body = dict(body) | {"material": dict(body["material"]) | {"cone": _BEFORE}}
        bodies.append(body)
    return dict(scene) | {"bodies": bodies}


def cone_warning(body: Mapping[str, Any], dimension: int) -> str | None:
    """Return what to say of a body of a scene file whose material means another cone than before.

    The reader of a run that continues names the cone instead (`with_cones`).
    """
    if dimension != 2 or not _unnamed(body):
        return None
    material = body["material"]
    given = material.get("friction_angle", 30.0)
    if not isinstance(given, int | float) or not 0 < given <= 89:
        return None
    acted = _acts_as(float(given))
    return (
        f"body '{body.get('name')}': {material['type']} names no cone: friction_angle {given:g} is "
        f"that in plane strain; until 0.1 it was that in triaxial compression, which acts as "
        f'{acted:.1f} degrees there; expected "cone": "plane-strain", or "compression" to '
        "keep what it was"
    )


def _acts_as(angle: float) -> float:
    """Return as which angle the cone of triaxial compression acts in plane strain, degrees."""
    s = math.sin(math.radians(angle))
    return math.degrees(math.asin(min(1.0, 2.0 * math.sqrt(3.0) * s / (3.0 - s))))


def _unnamed(body: Any) -> bool:
    material = body.get("material") if isinstance(body, Mapping) else None
    if not isinstance(material, Mapping) or "cone" in material:
        return False
    return material.get("type") in ("DruckerPrager", "CamClay")
