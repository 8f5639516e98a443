"""Ctrl-C, and the signals of batch systems, at a safe place."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

__all__ = [
    "STOP_SIGNALS",
    "asked_to_stop",
    "deferred_interrupt",
    "interrupt_noted",
    "stop_signals",
]

#: What schedulers send some time before they kill: Slurm, PBS and LSF SIGTERM, and with
#: ``--signal`` or ``-notify`` SIGUSR1.
STOP_SIGNALS = ("SIGTERM", "SIGUSR1")

_asked = ""
_noted = False


def _note(number: int, frame: object) -> None:
    global _noted
    _noted = True


def interrupt_noted() -> bool:
    """Tell whether Ctrl-C was pressed where it is held back; who waits long asks."""
    return _noted


@contextmanager
def deferred_interrupt() -> Iterator[Callable[[], bool]]:
    """Hold Ctrl-C until the loop asks: no sample is lost between the engine and the files.

    Only the main thread may set handlers, and a handler of the caller's own stays in charge. What
    nobody has answered at the end of the block is a `KeyboardInterrupt` there.
    """
    global _noted
    main = threading.current_thread() is threading.main_thread()
    handler = signal.getsignal(signal.SIGINT) if main else None
    if handler is _note:
        yield interrupt_noted
        return
    if handler is not signal.default_int_handler:
        yield lambda: False
        return
    _noted = False
    signal.signal(signal.SIGINT, _note)
    try:
        yield interrupt_noted
        if _noted:
            raise KeyboardInterrupt
    finally:
        _noted = False
        signal.signal(signal.SIGINT, signal.default_int_handler)


def asked_to_stop() -> str:
    """Return the name of the signal that asks runs to stop; empty where there was none."""
    return _asked


@contextmanager
def stop_signals() -> Iterator[None]:
    """Let the signals of batch systems ask runs to stop, instead of ending the process.

    A signal before the run's first step counts too. Outside the main thread, where handlers cannot
    be set, nothing changes.
    """
    global _asked

    def note(number: int, frame: object) -> None:
        global _asked
        _asked = signal.Signals(number).name

    _asked = ""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    numbers = [getattr(signal, name) for name in STOP_SIGNALS if hasattr(signal, name)]
    previous = [(n, signal.signal(n, note)) for n in numbers]
    try:
        yield
    finally:
        _asked = ""
        for number, handler in previous:
            signal.signal(number, handler)
