"""``python -m libmpm``: the command line."""

from __future__ import annotations

import sys

from libmpm._src.cli.commands import main

sys.exit(main())
