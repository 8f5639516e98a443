"""What other libraries change of a process's signals, put back."""

from __future__ import annotations

import ctypes
import signal

__all__ = ["ignore_broken_pipes"]


def ignore_broken_pipes() -> None:
    """Make a write into a pipe that nobody reads an error again, as Python has it.

    gmsh.initialize sets SIGPIPE to its default, in the C library, where Python does not see it: the
    next such write, into the queue of a worker that was killed say, ends the process without a
    word. A handler of the program's own is left as it is.
    """
    number = getattr(signal, "SIGPIPE", None)
    if number is None or signal.getsignal(number) != signal.SIG_IGN:
        return
    try:
        signal.signal(number, signal.SIG_IGN)
    except ValueError:  # only the main thread may, but for the C library all are alike
        ctypes.CDLL(None).signal(int(number), ctypes.c_void_p(int(signal.SIG_IGN)))
