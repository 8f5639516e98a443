"""Laws and numerical choices of ClaymoreUW as materials, F-bar and transfers."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Literal

from libmpm._src.compat.claymore.reader import Context
from libmpm._src.compat.claymore.records import BodyRecord
from libmpm._src.materials.generated import (
    CamClay,
    DruckerPrager,
    FixedCorotated,
    NeoHookean,
    TaitFluid,
    VonMises,
)
from libmpm._src.materials.material import Material
from libmpm._src.methods.method import FBar
from libmpm._src.methods.transfer import Transfer

__all__ = ["fbar_of", "material_of", "transfers_of"]

#: log_plastic_volume of a Cam-Clay that is not consolidated: p₀ = 10⁻⁵ K, as for 0 in the file.
_UNCONSOLIDATED = -1e-9


def material_of(context: Context, body: BodyRecord) -> Material:
    """Return the material of a body; raises `SceneError` where a number is out of range."""
    return _MAKERS[body.law](context, body)


def _fluid(context: Context, body: BodyRecord) -> Material:
    n = body.numbers
    return TaitFluid(
        density=n["rho"],
        bulk_modulus=n["bulk_modulus"],
        exponent=n["gamma"],
        viscosity=n["viscosity"],
    )


def _elastic(n: Mapping[str, float]) -> dict[str, float]:
    return {
        "density": n["rho"],
        "youngs_modulus": n["youngs_modulus"],
        "poissons_ratio": n["poisson_ratio"],
    }


def _fixed_corotated(context: Context, body: BodyRecord) -> Material:
    return FixedCorotated(**_elastic(body.numbers))


def _neo_hookean(context: Context, body: BodyRecord) -> Material:
    context.note(
        f"{body.path}: NeoHookean has the energy that its stress belongs to; ClaymoreUW's force "
        "and energy differ in the volume term, at strains of order one"
    )
    return NeoHookean(**_elastic(body.numbers))


def _drucker_prager(context: Context, body: BodyRecord) -> Material:
    """Return sand; the file's cohesion c is a logarithmic strain (Klár et al. 2016).

    Its cone has the apex at the strain c on every axis: mean tension (dλ + 2μ) c = 3K c, with
    3K = E/(1 - 2ν), which is the apex C cot φ of a cohesion C in Pa.
    """
    n = body.numbers
    if n["logJp0"] != 0:
        context.fail(
            body.path,
            f"has logJp0 {n['logJp0']:g} for DruckerPrager: sand that begins with volume to close "
            "is refused; set logJp0 to 0 and the density to that of the state",
        )
    tension = n["youngs_modulus"] / (1 - 2 * n["poisson_ratio"]) * n["cohesion"]
    slope = math.tan(math.radians(n["friction_angle"]))
    if n["cohesion"]:
        context.note(
            f"{body.path}: cohesion {n['cohesion']:g} is a logarithmic strain in ClaymoreUW; it is "
            f"{tension * slope:.4g} Pa, with mean tension up to {tension:.4g} Pa"
        )
    return DruckerPrager(
        **_elastic(n),
        friction_angle=n["friction_angle"],
        cohesion=tension * slope,
        tension_cutoff=tension,
        volume_correction=n["beta"] if n["SandVolCorrection"] else 0.0,
        cone="compression",
    )


def _cam_clay(context: Context, body: BodyRecord) -> Material:
    n = body.numbers
    if n["friction_angle"] != 45:
        context.note(
            f"{body.path}: friction_angle {n['friction_angle']:g}° holds; ClaymoreUW takes 45° "
            "for NACC whatever the file says"
        )
    return CamClay(
        **_elastic(n),
        log_plastic_volume=min(n["logJp0"], _UNCONSOLIDATED),
        friction_angle=n["friction_angle"],
        cohesion_ratio=n["beta"],
        hardening_factor=n["xi"],
        hardens=n["hardeningOn"],
        cone="compression",
    )


def _von_mises(context: Context, body: BodyRecord) -> Material:
    n = body.numbers
    return VonMises(
        **_elastic(n),
        yield_stress=n["tensile_yield_strength"],
        hardening_modulus=n["hardening_modulus"],
    )


_MAKERS: Mapping[str, Callable[[Context, BodyRecord], Material]] = {
    "fluid": _fluid,
    "fixed-corotated": _fixed_corotated,
    "neo-hookean": _neo_hookean,
    "drucker-prager": _drucker_prager,
    "cam-clay": _cam_clay,
    "von-mises": _von_mises,
}


def fbar_of(context: Context, body: BodyRecord, material: Material) -> FBar | None:
    """Return the volume smoothing of a body.

    ClaymoreUW mixes ψ of the grid's average into a second stored volume, per step: the form
    "two-volume" with that ratio, or "split" where the average has a transfer of its own.
    """
    if body.fbar is None:
        return None
    if not material.table.fbar:
        context.note(
            f"{body.path}: FBAR_psi {body.fbar:g} is left out; {material.table.name} has no volume "
            "smoothing"
        )
        return None
    context.note(
        f"{body.path}: FBAR_psi is the share ψ per step, so the result depends on the time step "
        "and on cell_size; FBar(length=) would not"
    )
    return FBar(form="split" if body.split else "two-volume", ratio=body.fbar)


def transfers_of(
    context: Context, bodies: Sequence[BodyRecord]
) -> tuple[Transfer, list[Transfer | None]]:
    """Return the transfer of the scene and those of its bodies.

    Where no body keeps a share α of its own velocity it is APIC, whatever `use_ASFLIP` says; a
    shift β of nothing is nothing.
    """
    if not any(body.alpha for body in bodies):
        return Transfer(), [None] * len(bodies)
    shifted = any(body.alpha and body.beta[1] for body in bodies)
    scheme: Literal["ASFLIP", "AFLIP"] = "ASFLIP" if shifted else "AFLIP"
    if shifted:
        context.note(
            "ASFLIP: particles that a boundary holds are not shifted (Transfer.guard); ClaymoreUW "
            "shifts them too"
        )
    own: list[Transfer | None] = []
    for body in bodies:
        low, high = body.beta if shifted and body.alpha else (0.0, 0.0)
        own.append(Transfer(scheme=scheme, flip=body.alpha, shift_min=low, shift_max=high))
    strongest = max(range(len(bodies)), key=lambda i: bodies[i].alpha)
    whole = own[strongest]
    assert whole is not None
    return whole, own
