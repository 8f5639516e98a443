"""The transfer of a scene whose method names none.

APIC loses what a flow has in eddies and in gaps of a few cells: a slot of two cells lets 0.05 of
the water through that it should, AFLIP with flip 0.95 0.24, with 0.99 0.54 (`docs/tradeoff.md`);
the load on the box of a flume is 2.6 times the measured one with 0.95 and 1.9 with 0.99. From 0.995
on water at rest does not come to rest. Columns of sand in 20 cells run out by 0.78 to 0.80 of what
was measured with it where the heap or its front is thin, by 0.91 to 0.97 with AFLIP
(`docs/reference-cases.md`). Elsewhere APIC costs less, and is quieter: what a piston alone stirs
for half a minute packs, and sooner with AFLIP (`design/fbar.md`, 4).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from libmpm._src.boundaries.responses import Mirror, Separable, Slip
from libmpm._src.materials.generated import DruckerPrager
from libmpm._src.methods.method import Method
from libmpm._src.methods.transfer import Transfer
from libmpm._src.scene.parts import Body, Boundary
from libmpm._src.shapes.solid import Solid

__all__ = ["PAST_STRUCTURES", "default_transfer", "is_structure"]

_PLAIN = Transfer()
#: Of less a flow loses more, of more noise is left (`docs/tradeoff.md`).
PAST_STRUCTURES = Transfer(scheme="AFLIP", flip=0.99)
_GRAINS = Transfer(scheme="AFLIP", flip=0.95)


class _Scene(Protocol):
    """What is asked of a scene (`scene/data.py`)."""

    @property
    def dimension(self) -> int: ...
    @property
    def grid(self) -> Any: ...
    @property
    def cell_size(self) -> float: ...
    @property
    def lower(self) -> Sequence[float]: ...
    @property
    def upper(self) -> Sequence[float]: ...
    @property
    def gravity(self) -> Any: ...
    @property
    def method(self) -> Method: ...
    @property
    def bodies(self) -> Sequence[Body]: ...
    @property
    def boundaries(self) -> Sequence[Boundary]: ...


def is_structure(scene: _Scene, boundary: Boundary) -> bool:
    """Whether a fluid flows past a boundary: it rests, slips, and is no bed.

    A bed goes through the whole domain along each axis but that of gravity, up to a cell.
    """
    slips = any(isinstance(r, Slip | Separable) for r in boundary.responses)
    if not isinstance(boundary.shape, Solid) or not boundary.at_rest or not slips:
        return False
    if not isinstance(scene.gravity, tuple) or not any(scene.gravity):
        return True
    size = [abs(g) for g in scene.gravity]
    up, cell = size.index(max(size)), scene.cell_size
    low, high = boundary.shape.bounds()
    across = [a for a in range(scene.dimension) if a != up]
    return not all(
        low[a] <= scene.lower[a] + cell and high[a] >= scene.upper[a] - cell for a in across
    )


def default_transfer(scene: _Scene) -> Transfer:
    """Return AFLIP where a fluid flows past a structure (0.99) or grains flow (0.95), else APIC.

    APIC as well where particles that keep their velocity are refused or not known to do well: grids
    of functions, other kernels than quadratic splines, smoothing over cells, assumed fields, placed
    forces, mirrored walls. What is measured does not count: sensors change no bit.
    """
    past = any(is_structure(scene, b) for b in scene.boundaries)
    if past and any(body.material.table.stores_volume for body in scene.bodies):
        wanted = PAST_STRUCTURES
    elif any(isinstance(body.material, DruckerPrager) for body in scene.bodies):
        wanted = _GRAINS
    else:
        return _PLAIN
    kernel = scene.method.kernel_choice
    plain = (
        scene.grid is None
        and kernel.name == "quadratic"
        and not kernel.boundary
        and not any(isinstance(r, Mirror) for b in scene.boundaries for r in b.responses)
        and not any(b.smoothing or b.assumed or b.force for b in scene.bodies)
    )
    return wanted if plain else _PLAIN
