"""Descriptions of the grids of triangles and of splines."""
