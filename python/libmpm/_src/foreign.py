"""Arrays of other libraries brought to the host."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from libmpm._src.errors import Error

__all__ = ["host_array"]

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
    tries = []
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
