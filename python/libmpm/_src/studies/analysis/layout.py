"""Numbers in printed tables."""

from __future__ import annotations

import math

__all__ = ["number"]


def number(value: float, form: str = ".4g") -> str:
    """Return a number as text, and nothing where it is NaN."""
    return "" if math.isnan(value) else format(value, form)
