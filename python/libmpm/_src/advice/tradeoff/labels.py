"""Rows and values in a few words."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from libmpm._src.base.values import Value

if TYPE_CHECKING:
    from libmpm._src.advice.tradeoff.result import TradeOff

__all__ = ["label_of", "short"]


def label_of(row: Mapping[str, Any], table: TradeOff) -> str:
    """Return the parameters of a row in short, without those that all rows share."""
    shown: Sequence[str] = [
        name for name in table.parameters if len({str(r.get(name)) for r in table.rows}) > 1
    ]
    return ", ".join(f"{n}={short(row.get(n))}" for n in shown or table.parameters)


def short(item: Any) -> str:
    """Return a value in short: numbers with five digits, values with what is not their default."""
    if item is None:
        return ""
    if isinstance(item, float):
        return f"{item:.5g}" if math.isfinite(item) else str(item)
    if isinstance(item, Value):
        changed = {
            k: v
            for k, v in vars(item).items()
            if v is not None and v != getattr(type(item), k, None)
        }
        first = next((k for k in ("scheme", "name", "form") if hasattr(item, k)), None)
        head = str(getattr(item, first)) if first else type(item).__name__
        rest = ", ".join(f"{k}={short(v)}" for k, v in changed.items() if k != first)
        return f"{head}({rest})" if rest else head
    return str(item)
