"""The transfer of a scene whose method names none.

APIC loses what a flow has in eddies and gaps of a few cells: a slot of two cells lets 0.05 of the
water through that it should, AFLIP 0.24, and of four 0.22 and 0.95 (`docs/tradeoff.md`); the load
on the box of a flume is 3 times as large. Elsewhere APIC costs less and is the quieter one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from libmpm._src.boundaries.responses import Mirror
from libmpm._src.methods.transfer import Transfer
from libmpm._src.sensors.engine_sensors import LoadCell

if TYPE_CHECKING:
    from libmpm._src.scene.data import SceneData

__all__ = ["default_transfer"]

_PLAIN = Transfer()
#: Of loads: blends that keep less lose more, such that keep more leave noise (`docs/walls.md`).
_OF_LOADS = Transfer(scheme="AFLIP", flip=0.95)


def default_transfer(scene: SceneData) -> Transfer:
    """Return AFLIP with flip 0.95 where a load cell weighs what a fluid does, else APIC.

    APIC as well where particles that keep their velocity are not known to do well or are refused:
    grids of functions, other kernels than quadratic splines, smoothing over cells, assumed fields,
    placed forces, mirrored walls.
    """
    if not any(isinstance(placed.sensor, LoadCell) for placed in scene.sensors):
        return _PLAIN
    kernel = scene.method.kernel_choice
    plain = (
        scene.grid is None
        and kernel.name == "quadratic"
        and not kernel.boundary
        and not any(b.smoothing or b.assumed or b.force for b in scene.bodies)
        and not any(isinstance(r, Mirror) for b in scene.boundaries for r in b.responses)
    )
    fluid = any(body.material.table.stores_volume for body in scene.bodies)
    return _OF_LOADS if plain and fluid else _PLAIN
