"""Grids of triangles and of splines in place of square cells."""
