"""Fields of debris: ordered arrays, random fields, their measures and their pictures."""

from libmpm._src.studies.debris.field import DebrisField as Field
from libmpm._src.studies.debris.field import Placement
from libmpm._src.studies.debris.laws import Angles, SpreadAngles, UniformAngles
from libmpm._src.studies.debris.mesh import Tetrahedra
from libmpm._src.studies.debris.metadata import save_metadata
from libmpm._src.studies.debris.ordered import ordered
from libmpm._src.studies.debris.prototype import Piece, Prototype
from libmpm._src.studies.debris.random import PlacementError, random

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
