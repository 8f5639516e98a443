"""Materials. Every class follows from the table of the compiled core."""

from libmpm._src.materials import generated as _generated
from libmpm._src.materials.generated import *  # noqa: F403
from libmpm._src.materials.material import Material

__all__ = [*_generated.__all__, "Material"]
