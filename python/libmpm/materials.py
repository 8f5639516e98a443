"""Materials. Every class follows from the table of the compiled core."""

from typing import TYPE_CHECKING, Any

from libmpm._src.materials import generated as _generated
from libmpm._src.materials.generated import *  # noqa: F403
from libmpm._src.materials.material import Material
from libmpm._src.materials.rigid import Rigid

if TYPE_CHECKING:
    from libmpm._src.materials.compiled import from_header

__all__ = [*_generated.__all__, "Material", "Rigid", "from_header"]


def __getattr__(name: str) -> Any:
    """Load what compiles materials on first use."""
    if name == "from_header":
        from libmpm._src.materials.compiled import from_header

        return from_header
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
