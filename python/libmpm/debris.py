"""Fields of debris: ordered arrays, random fields, their measures and their pictures."""

from libmpm._src.debris.field import DebrisField as Field
from libmpm._src.debris.field import Placement
from libmpm._src.debris.laws import Angles, SpreadAngles, UniformAngles
from libmpm._src.debris.mesh import Tetrahedra
from libmpm._src.debris.metadata import save_metadata
from libmpm._src.debris.ordered import ordered
from libmpm._src.debris.prototype import Piece, Prototype
from libmpm._src.debris.random import PlacementError, random

__all__ = [
    "Angles",
    "Field",
    "Piece",
    "Placement",
    "PlacementError",
    "Prototype",
    "SpreadAngles",
    "Tetrahedra",
    "UniformAngles",
    "ordered",
    "random",
    "save_metadata",
]
