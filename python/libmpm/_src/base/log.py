"""The logger "libmpm": what runs do and when, as info, tip, warning and error."""

from __future__ import annotations

import logging

__all__ = ["LOG", "TIP"]

#: Level of what would make a run better and is nothing wrong: between info and warning.
TIP = 25
logging.addLevelName(TIP, "TIP")

#: Silent until a program asks for it, for instance by ``logging.basicConfig(level="INFO")``.
LOG = logging.getLogger("libmpm")
LOG.addHandler(logging.NullHandler())
