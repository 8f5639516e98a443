"""Solids by signed distance: primitives, combinations, beds, surface meshes."""
