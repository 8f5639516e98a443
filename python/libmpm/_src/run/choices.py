"""What a run may ask for besides its scene, and what "auto" stands for: precision, device."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from libmpm._src.base.arguments import is_number, known, nearest, shown
from libmpm._src.base.log import LOG
from libmpm._src.base.values import MOST
from libmpm._src.errors import SceneError
from libmpm._src.run import backends
from libmpm._src.scene.contact_fields import device_of_rigid, rigid_bodies
from libmpm._src.shapes.element_mesh import ElementMesh

if TYPE_CHECKING:
    from libmpm._src.scene.data import SceneData

__all__ = [
    "PIPELINES", "PRECISIONS", "built_for_cpu", "check_backend", "check_options", "choose_device",
    "choose_precision",
]  # fmt: skip

PRECISIONS = ("single", "mixed", "double")
#: "by-body" is what a plan says where bodies have several, and as an option the same as "auto".
PIPELINES = ("auto", "fused", "two-pass", "phased", "by-body")

#: Threads of a run; machines with more cores run several.
_MOST_THREADS = 1024


def check_options(
    precision: str, pipeline: str, *, time_step: float | None = None, threads: int = 0
) -> list[str]:
    """Return what is wrong with the options of a run."""
    problems = []
    if not known(precision, PRECISIONS):
        problems.append(f"precision is {shown(precision)}; {nearest(precision, PRECISIONS)}")
    if not known(pipeline, PIPELINES):
        problems.append(f"pipeline is {shown(pipeline)}; {nearest(pipeline, PIPELINES)}")
    if time_step is not None and not (is_number(time_step) and 1 / MOST <= time_step < MOST):
        problems.append(f"time_step is {shown(time_step)}; expected > 0 s, or None: the stable one")
    # Beyond what a system can start, OpenMP ends the process.
    if not isinstance(threads, int) or not 0 <= threads <= _MOST_THREADS:
        problems.append(
            f"threads is {shown(threads, 40)}; expected ≥ 0 and ≤ {_MOST_THREADS}; 0 takes all"
        )
    return problems


def choose_precision(scene: SceneData, precision: str) -> str:
    """Return the precision that "auto" stands for: double on grids of functions, else single."""
    if scene.grid is None:
        return "single" if known(precision, ("auto",)) else precision
    if not known(precision, ("auto", "double")):
        raise SceneError(
            f"precision is {shown(precision)} on a grid of functions, which is built in "
            "double alone; use 'double' or 'auto'"
        )
    return "double"


def built_for_cpu(scene: SceneData) -> str:
    """Return what of a scene the CPU alone is built for, in words; "" where there is no such thing.

    What CUDA devices lack is what the engine's plan refuses for them by name.
    """
    if scene.grid is not None:
        return "a grid of functions"
    if rigid := rigid_bodies(scene):
        return f"rigid body '{rigid[0]}'"
    kernel = scene.method.kernel_choice
    if kernel.name in ("cpdi", "ddmp") or kernel.modified or kernel.moved_nodes:
        changed = "modified " if kernel.modified else ""
        return changed + kernel.text() + (" by moved nodes" if kernel.moved_nodes else "")
    for body in scene.bodies:
        parts = {
            "with assumed fields": body.assumed is not None,
            "with numerical damping": body.damping > 0 and not isinstance(body.shape, ElementMesh),
            "with a placed force": body.force is not None,
        }
        for what in (what for what, there in parts.items() if there):
            return f"body '{body.name}' {what}"
    return ""


def choose_device(scene: SceneData, device: str | Sequence[str]) -> str | Sequence[str]:
    """Return the device of a scene: as asked for, or what "auto" stands for where that is known.

    "auto" is the CPU for what is built for it alone, and the log says so at level info where there
    is a CUDA device. Raises `SceneError` where another device is asked for by name.
    """
    added = {body.name: body.material.label for body in scene.bodies if body.material.added}
    if added:
        from libmpm._src.materials.compiled import device_for

        device = device_for(added, device)
    if known(device, ("auto",)):
        what = built_for_cpu(scene)
        if what and backends.cuda_status().devices:
            LOG.info("%s: on the CPU, as %s is not built for CUDA devices", scene.name, what)
        return "cpu" if what else device
    if scene.grid is None or known(device, ("cpu",)):
        return device_of_rigid(scene, device)
    raise SceneError(
        f"device is {shown(device)} on a grid of functions, which is built for the CPU "
        "alone; use 'cpu' or 'auto'"
    )


def check_backend(kind: str, precision: str) -> None:
    """Refuse a precision that a backend, "cpu" or "cuda", does not have."""
    if kind == "cpu" and known(precision, ("mixed",)):
        raise SceneError(
            "precision is 'mixed'; on the CPU it would compute what 'double' does and save little; "
            "use precision='double' there, or a CUDA device"
        )
