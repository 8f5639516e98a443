"""Arrays of other libraries (DLPack, GPU arrays, frames) on the host; arrays that copies share."""

from __future__ import annotations

import numbers
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

import numpy as np
from numpy.typing import NDArray

from libmpm._src.errors import Error

__all__ = ["are_shared", "arrays_shared", "host_array", "real_array"]

#: Device types of DLPack that a processor can read: its own memory, pinned and managed memory.
_READABLE = (1, 3, 13)


def host_array(array: Any, what: str) -> NDArray[Any]:
    """Return any library's array as a NumPy array on the host, copied where it is on a device.

    Takes nested sequences and whatever has DLPack, ``__array_interface__`` or, like CuPy's and
    PyTorch's, a method ``get`` or ``cpu``. Raises `Error` naming `what`.
    """
    place = getattr(array, "__dlpack_device__", None)
    if place is None or isinstance(array, np.ndarray):
        return np.asarray(array)
    tries: list[Callable[[], Any]] = []
    if int(place()[0]) in _READABLE:
        tries.append(lambda: np.from_dlpack(array))
    else:
        tries.append(lambda: np.from_dlpack(array, device="cpu"))
    tries += [
        lambda: np.asarray(array.get()),
        lambda: np.asarray(array.detach().cpu()),
        lambda: np.asarray(array),
    ]
    said = []
    for attempt in tries:
        try:
            found = np.asarray(attempt())
            if found.dtype.kind in "biufc":
                return found
            said.append(f"it gives an array of {found.dtype}")
        except (AttributeError, BufferError, RuntimeError, TypeError, ValueError) as error:
            said.append(str(error))
    raise Error(f"{what}: {type(array).__name__} cannot be brought to the host ({said[0]}); give "
                "a NumPy array, or an array with DLPack")  # fmt: skip


def real_array(array: Any, what: str) -> NDArray[np.float64]:
    """Return any library's array of real numbers as float64 on the host.

    NumPy by itself takes texts that look like numbers, truth values, dates, what is masked, and the
    real part of complex numbers. Raises `ValueError` or `TypeError` for those and for what has no
    regular shape, `OverflowError` for whole numbers beyond 1.8e308, and `Error` as `host_array`.
    """
    if isinstance(array, np.ma.MaskedArray) and np.ma.is_masked(array):
        raise ValueError(f"{what} has masked entries")
    try:
        found = host_array(array, what)
    except (RecursionError, ValueError) as error:
        raise ValueError(f"{what} has no regular shape") from error
    if found.dtype.kind == "O":
        if not all(isinstance(x, numbers.Real) and not isinstance(x, bool) for x in found.flat):
            raise TypeError(f"{what} has entries that are no numbers")
    elif found.dtype.kind not in "iuf":
        raise TypeError(f"{what} is an array of {found.dtype}")
    return np.asarray(found, dtype=np.float64)


_shared: ContextVar[bool] = ContextVar("libmpm_arrays_shared", default=False)


@contextmanager
def arrays_shared() -> Iterator[None]:
    """Let `to_dict` leave values with `holds_arrays` as they are: for copies, not for files.

    They cannot change, and a million elements as lists of numbers take half a minute both ways.
    """
    token = _shared.set(True)
    try:
        yield
    finally:
        _shared.reset(token)


def are_shared() -> bool:
    """Return whether they are at this moment."""
    return _shared.get()
