"""Fields of debris: ordered arrays, random fields, their measures and their pictures."""

from libmpm._src.moved import renamed
from libmpm._src.studies.debris.field import DebrisField, Placement
from libmpm._src.studies.debris.laws import Angles, SpreadAngles, UniformAngles
from libmpm._src.studies.debris.mesh import DebrisMesh
from libmpm._src.studies.debris.metadata import save_metadata
from libmpm._src.studies.debris.ordered import ordered
from libmpm._src.studies.debris.prototype import Piece, Prototype
from libmpm._src.studies.debris.random import PlacementError, random

#: Names of version 0.1; `libmpm.Field` is a formula, `shapes.Tetrahedra` a body of elements.
__getattr__ = renamed(__name__, {"Field": "DebrisField", "Tetrahedra": "DebrisMesh"})

__all__ = [
    "Angles",
    "DebrisField",
    "DebrisMesh",
    "Piece",
    "Placement",
    "PlacementError",
    "Prototype",
    "SpreadAngles",
    "UniformAngles",
    "ordered",
    "random",
    "save_metadata",
]
