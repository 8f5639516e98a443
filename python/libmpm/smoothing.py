"""The operators of smoothing for arrays, by their name of version 0.1: now in `libmpm.methods`."""

import warnings

from libmpm._src.methods.smoothing import METHODS, Smoothed, smooth

__all__ = ["METHODS", "Smoothed", "smooth"]

warnings.warn(
    "libmpm.smoothing is part of libmpm.methods since libmpm 0.2; the old name goes in 0.3",
    DeprecationWarning,
    stacklevel=2,
)
