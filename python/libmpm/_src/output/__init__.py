"""Result files: frames, sensor series, checkpoints, and the folder that holds them."""

from __future__ import annotations

from libmpm._src.output.writer import Output

__all__ = ["Output"]
