"""Numerical choices: transfer, kernel, F-bar, smoothing over cells."""
