"""The description of a simulation: `Scene`, its files, its rules, its scaling."""

from libmpm._src.moved import forward

__getattr__ = forward("scene")  # names of version 0.1
