"""The names of the axes: x, y, z."""

__all__ = ["AXES"]

#: In the order of coordinates; 2D has the first two.
AXES = ("x", "y", "z")
