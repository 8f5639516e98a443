"""Smoothing of fields over cells, for arrays: the operators of `libmpm.Smoothing` (Yang 2016)."""

from libmpm._src.methods.smoothing import METHODS, Smoothed, smooth

__all__ = ["METHODS", "Smoothed", "smooth"]
