"""The command line: `libmpm run`, `plan`, `check`, `info`, `bench` and the others."""

from libmpm._src.moved import forward

__getattr__ = forward("cli")  # names of version 0.1
