"""Numerical choices: transfer between particles and grid, kernel, F-bar, smoothing over cells.

`Method` has those of a scene, `add_body` takes those of a body. `smooth` is the operator of
`Smoothing` for arrays (Yang 2016).
"""

from libmpm._src.methods.method import FBar, Method
from libmpm._src.methods.smoothing import METHODS, AssumedFields, Smoothed, Smoothing, smooth
from libmpm._src.methods.transfer import Kernel, Transfer

__all__ = ["METHODS", "AssumedFields", "FBar", "Kernel", "Method", "Smoothed", "Smoothing"]
__all__ += ["Transfer", "smooth"]
