"""Walls, structures, inlets, outlets and wave makers: how they move and what they do."""

from libmpm._src.moved import forward

__getattr__ = forward("boundaries")  # names of version 0.1
