"""Materials. Every class but `Rigid` follows from the table of the compiled core."""

from typing import TYPE_CHECKING, Any

from libmpm._src.materials import generated as _generated
from libmpm._src.materials.generated import *  # noqa: F403
from libmpm._src.materials.material import Material

if TYPE_CHECKING:
    from libmpm._src.materials.compiled import from_header
    from libmpm._src.materials.rigid import Rigid

__all__ = [*_generated.__all__, "Material", "Rigid", "from_header"]


def __getattr__(name: str) -> Any:
    """Load on first use what compiles materials, and what few scenes have."""
    if name == "from_header":
        from libmpm._src.materials.compiled import from_header

        return from_header
    if name == "Rigid":
        from libmpm._src.materials.rigid import Rigid

        return Rigid
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
