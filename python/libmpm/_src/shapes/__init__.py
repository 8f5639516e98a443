"""Shapes of bodies and boundaries, and how particles fill them."""

from libmpm._src.moved import forward

__getattr__ = forward("shapes")  # names of version 0.1
