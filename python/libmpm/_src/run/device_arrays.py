"""Particles on their device as arrays for CuPy, PyTorch and JAX (DLPack), without a copy.

An engine stores particles as offsets from the centres of their cells, in the order of the cells,
and no velocity. There is nothing of which a position could be a view. What is handed over is a
dense column, gathered on the engine's device: it belongs to whoever takes it, and says of which
moment it is.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from libmpm._src.base.values import nearest, shown
from libmpm._src.errors import Error
from libmpm._src.output.frames import UNITS

if TYPE_CHECKING:
    from libmpm._src.run.running import Running

__all__ = ["DeviceArrays", "ParticleArray"]

#: Device types of DLPack.
_CPU, _CUDA = 1, 2


class ParticleArray:
    """One attribute of the particles of a body, dense in the memory of the simulation's device.

    Scalars are (n,), vectors (n, dimension), tensors (n, dimension, dimension), float64 in SI
    units; ``id`` is uint64 and ``position`` in world coordinates, m. Row k is the same particle as
    row k of ``sim.particles[body]``. Other libraries take it by DLPack (``numpy.from_dlpack``,
    ``cupy.from_dlpack``, ``torch.from_dlpack``), by ``__array_interface__`` on the CPU and by
    ``__cuda_array_interface__`` (version 3) on CUDA devices. It is complete when it is handed over,
    so that no stream has to wait. Writing into it changes nothing of the run.

    Using it after the simulation has moved on, or after its ``with`` block, raises `Error`; what
    was taken before stays as it was. Beside a thread that runs the simulation, put the block into
    ``with sim.paused():``.
    """

    def __init__(self, owner: DeviceArrays, name: str, column: Any) -> None:
        """Wrap a column of the engine."""
        self._owner = owner
        self._column = column
        self.name = name

    @property
    def unit(self) -> str:
        """The SI unit, "1" for plain numbers."""
        return UNITS.get(self.name, "1")

    @property
    def shape(self) -> tuple[int, ...]:
        """Rows, then components."""
        return tuple(self._column.shape)

    @property
    def ndim(self) -> int:
        """Number of axes, 1 to 3."""
        return len(self.shape)

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of an element, float64 or uint64."""
        found: np.dtype[Any] = np.dtype(self._column.type)
        return found

    @property
    def device(self) -> str:
        """Where it is: "cpu" or "cuda:<index>"."""
        index = self._column.device
        return "cpu" if index < 0 else f"cuda:{index}"

    def __len__(self) -> int:
        """Return the number of particles."""
        return self.shape[0]

    def to_numpy(self) -> NDArray[Any]:
        """Return a copy on the host."""
        array: NDArray[Any] = self._valid().numpy()
        return array

    def _valid(self) -> Any:
        self._owner.check(self.name)
        return self._column

    def __dlpack_device__(self) -> tuple[int, int]:
        """Return DLPack's type and number of the device."""
        index = int(self._column.device)
        return (_CPU, 0) if index < 0 else (_CUDA, index)

    def __dlpack__(
        self,
        *,
        stream: int | Any | None = None,
        max_version: tuple[int, int] | None = None,
        dl_device: tuple[int, int] | None = None,
        copy: bool | None = None,
    ) -> Any:
        """Return a capsule; see the array API standard for the parameters."""
        column = self._valid()
        here = self.__dlpack_device__()
        if here[0] == _CPU and stream is not None:
            raise BufferError(f"array '{self.name}' is on the CPU and stream is {shown(stream)}; "
                              "expected None")  # fmt: skip
        if here[0] == _CUDA and stream == 0:
            raise BufferError(
                "stream is 0, which CUDA uses in two senses; expected None, -1, 1 (legacy "
                "default), 2 (per thread) or a stream's address"
            )
        versioned = max_version is not None and max_version[0] >= 1
        wanted = here if dl_device is None else (int(dl_device[0]), int(dl_device[1]))
        if wanted == here:
            return column.dlpack(versioned, bool(copy))
        if wanted[0] != _CPU or copy is False:
            raise BufferError(
                f"array '{self.name}' is on {self.device} and dl_device is {wanted} with copy="
                f"{copy}; expected its own device, or the CPU's (1, 0) where copying is allowed"
            )
        # The old protocol has nothing but the CPU's stream, and NumPy knows both structures.
        version = {"max_version": max_version} if versioned else {}
        return column.numpy().__dlpack__(**version)

    @property
    def __array_interface__(self) -> dict[str, Any]:
        """NumPy's description of the memory; only on the CPU."""
        if self._column.device >= 0:
            raise AttributeError(f"array '{self.name}' is on {self.device}")
        return self._interface()

    @property
    def __cuda_array_interface__(self) -> dict[str, Any]:
        """The description of the memory, version 3; only on CUDA devices."""
        if self._column.device < 0:
            raise AttributeError(f"array '{self.name}' is on the CPU")
        return self._interface() | {"stream": None}

    def _interface(self) -> dict[str, Any]:
        column = self._valid()
        return {
            "version": 3,
            "shape": self.shape,
            "typestr": column.type,
            "data": (column.pointer if self.size else 0, False),
            "strides": None,
        }

    @property
    def size(self) -> int:
        """Number of elements."""
        return int(np.prod(self.shape))

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """Return it as a NumPy array on the CPU; an array on a device is never copied unasked."""
        if self._column.device >= 0:
            raise TypeError(f"array '{self.name}' is on {self.device}; copy it to the host with "
                            ".to_numpy()")  # fmt: skip
        values: NDArray[Any] = self._valid().numpy()
        return values if dtype is None else values.astype(dtype)

    def __repr__(self) -> str:
        """Return name, shape, type, place and time."""
        return (
            f"<{self._owner.body}.{self.name} {self.shape} {self.dtype} [{self.unit}] on "
            f"{self.device} at {self._owner.time:g} s>"
        )


class DeviceArrays(Mapping[str, ParticleArray]):
    """The attributes of one body as arrays on the simulation's device, inside a ``with`` block.

    ``arrays.position`` or ``arrays["position"]`` gathers when first asked for. On the device itself
    are made: id, position, velocity, speed, kinetic_energy, mass, and volume_ratio of fluids;
    attributes that need the material's law (pressure, stress, ...) are worked out on the host and
    sent there. See `ParticleArray`.
    """

    def __init__(self, simulation: Running, body: str, fields: Sequence[str] = ()) -> None:
        """Name the body, and attributes to gather in one pass at the start of the block."""
        self._simulation = simulation
        self._index = list(simulation.particles).index(simulation.particles[body].name)
        self.body = body
        self._fields = tuple(fields)
        self._arrays: dict[str, ParticleArray] = {}
        self._engine: Any = None
        self._open = False
        for name in self._fields:
            self._known(name)

    def __enter__(self) -> DeviceArrays:
        """Note the moment; gather what was named."""
        with self._simulation.paused():
            self._engine = self._simulation.engine
            self.generation = int(self._engine.generation)
            self.time = self._simulation.time
            self._open = True
            self._arrays = {}
            if self._fields:
                self._gather(self._fields)
        return self

    def __exit__(self, *exception: object) -> None:
        """End the use of its arrays."""
        self._open = False
        # They hold this object: a circle would keep a device's memory until it is found.
        self._arrays = {}

    def check(self, name: str) -> None:
        """Raise `Error` unless the arrays are of the present moment."""
        what = f"array '{name}' of body '{self.body}'"
        again = f"take it again in a new block: with sim.device_arrays('{self.body}') as arrays"
        if not self._open:
            when = f" (generation {self.generation})" if self._engine is not None else ""
            raise Error(f"{what} is used outside its `with` block{when}; {again}")
        now = self._simulation.engine
        if now is not self._engine or now.generation != self.generation:
            raise Error(
                f"{what} is of generation {self.generation}, {self.time:g} s; the simulation is at "
                f"generation {now.generation}, {self._simulation.time:g} s; {again}"
            )

    def _known(self, name: str) -> None:
        names = self._simulation.particles[self.body].names
        if name not in names:
            raise KeyError(f"body '{self.body}' has no attribute '{name}'; {nearest(name, names)}")

    def _gather(self, names: Sequence[str]) -> None:
        origin = [float(x) for x in self._simulation.offset]
        columns = self._engine.gather(self._index, list(dict.fromkeys(names)), origin)
        for name, column in columns.items():
            self._arrays[name] = ParticleArray(self, name, column)

    def __getitem__(self, name: str) -> ParticleArray:
        """Return one attribute, gathered when first asked for."""
        with self._simulation.paused():
            self.check(name)
            if name not in self._arrays:
                self._known(name)
                self._gather([name])
            return self._arrays[name]

    def __getattr__(self, name: str) -> ParticleArray:
        """Return one attribute."""
        if name.startswith("_"):
            raise AttributeError(name)
        try:
            return self[name]
        except KeyError as error:
            raise AttributeError(error.args[0]) from None

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names of all attributes."""
        return iter(self._simulation.particles[self.body].names)

    def __len__(self) -> int:
        """Return the number of attributes."""
        return len(self._simulation.particles[self.body].names)

    def __repr__(self) -> str:
        """Return body, device and moment."""
        state = f"generation {self.generation}" if self._open else "closed"
        return f"<arrays of body '{self.body}' on {self._simulation.device}, {state}>"
