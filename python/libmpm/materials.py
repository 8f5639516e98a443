"""Materials. Every class follows from the table of the compiled core."""

from libmpm._src import materials_generated as _generated
from libmpm._src.materials_generated import *  # noqa: F403
from libmpm._src.parameters import Material

__all__ = [*_generated.__all__, "Material"]
