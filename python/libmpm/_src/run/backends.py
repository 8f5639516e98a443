"""Which compiled module and device run a simulation: CPU, CUDA, how many."""

from __future__ import annotations

import functools
import importlib
import importlib.util
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from libmpm._src.base.arguments import known, shown
from libmpm._src.errors import DeviceError, Error
from libmpm._src.run.rank_messages import Link

__all__ = [
    "Backend",
    "CudaStatus",
    "core",
    "cuda_status",
    "memory_free",
    "parse_device",
    "select",
    "select_process",
]


@dataclass(frozen=True)
class Backend:
    """A compiled module and one of its devices: `name` is "cpu" or "cuda:<index>".

    `ranks` share a scene, each with its own part of it; on CUDA `indices` are their devices, each
    as its process counts them. `name` is the device of the first, or of this process where ranks
    are processes: then `link` is what it tells the others through.
    """

    name: str
    module: Any
    index: int
    ranks: int = 1
    indices: tuple[int, ...] = ()
    link: Link | None = None

    @property
    def kind(self) -> str:
        """Either "cpu" or "cuda"."""
        return self.name.partition(":")[0]

    @property
    def devices(self) -> list[str]:
        """The device of each rank."""
        if self.kind == "cpu":
            return ["cpu"] * self.ranks
        return [f"cuda:{index}" for index in self.indices or (self.index,)]


@dataclass(frozen=True)
class CudaStatus:
    """What is known about CUDA: the module or None, its devices, and why it cannot be used."""

    module: Any
    devices: tuple[dict[str, Any], ...]
    reason: str


def core() -> Any:
    """Return the compiled CPU module."""
    try:
        return importlib.import_module("libmpm._core")
    except ImportError as error:
        raise DeviceError(
            f"the compiled module libmpm._core cannot be loaded: {error}; "
            "install libmpm with `pip install .` rather than importing its source folder"
        ) from error


def memory_free(backend: Backend) -> int | None:
    """Return the bytes that a device can still give, or None where that is unknown."""
    if backend.kind == "cuda":
        found = backend.module.devices()
        if backend.link is not None:  # devices that share a scene are alike
            return int(found[backend.index]["free"]) * backend.ranks
        return sum(int(found[index]["free"]) for index in {*backend.indices, backend.index})
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
    except OSError:
        return None
    found = [int(line.split()[1]) * 1024 for line in lines if line.startswith("MemAvailable:")]
    return found[0] if found else None


@functools.cache
def cuda_status() -> CudaStatus:
    """Load the CUDA module if it was built, and look for devices; the answer is kept."""
    # Queues between host and device, read when CUDA starts. With CUDA's own 8, many scenes at a
    # time on one device wait for each other: 2.5e9 particle-steps/s in place of 3.6e9 with 16
    # scenes of 1e5. What the user has set stands.
    os.environ.setdefault("CUDA_DEVICE_MAX_CONNECTIONS", "32")
    try:
        module = importlib.import_module("libmpm._cuda")
    except ModuleNotFoundError:
        return CudaStatus(
            None,
            (),
            "this libmpm was built without CUDA; install nvcc and rebuild with LIBMPM_CUDA=ON",
        )
    except ImportError as error:
        return CudaStatus(None, (), f"the CUDA module cannot be loaded: {error}")
    try:
        found = tuple(module.devices())
    except (Error, RuntimeError) as error:
        return CudaStatus(module, (), str(error))
    if not found:
        return CudaStatus(module, (), "the driver lists no device; see `nvidia-smi` and "
                          "CUDA_VISIBLE_DEVICES")  # fmt: skip
    return CudaStatus(module, found, "")


def parse_device(device: str | Sequence[str]) -> tuple[str, int]:
    """Return kind ("cpu" or "cuda") and index of a device name; the device need not exist.

    "auto" is the first CUDA device if there is one and the CPU otherwise. Several, which share a
    scene, are all of them "cpu" or all CUDA devices; the index is that of the first.
    """
    if not isinstance(device, str):
        names = list(device) if isinstance(device, list | tuple) else []
        if names and all(known(name, ("cpu",)) for name in names):
            return ("cpu", 0)
        if names and all(isinstance(x, str) and re.fullmatch("cuda(:[0-9]+)?", x) for x in names):
            return parse_device(names[0])
        raise DeviceError(
            f"device is {shown(device)}: several devices share a scene where all are 'cpu' "
            "(['cpu', 'cpu']) or all are CUDA devices (['cuda:0', 'cuda:1'])"
        )
    if device == "auto":
        return ("cuda" if cuda_status().devices else "cpu", 0)
    match = re.fullmatch(r"cpu|cuda(?::([0-9]+))?", device)
    if match is None:
        raise DeviceError(
            f"device is {shown(device)}; expected 'auto', 'cpu', 'cuda' or 'cuda:<index>'"
        )
    return (device.partition(":")[0], int(match[1] or 0))


def select(device: str | Sequence[str] = "auto") -> Backend:
    """Return the backend of "auto", "cpu", "cuda", "cuda:<index>", or of ranks: ["cpu", "cpu"].

    Ranks on CUDA are as many names, such as ["cuda:0", "cuda:1"]; a device may be named twice.

    A missing device is a `DeviceError` that says what was found and what to do.
    """
    kind, index = parse_device(device)
    if kind == "cpu":
        return Backend("cpu", core(), 0, 1 if isinstance(device, str) else len(device))
    status = cuda_status()
    if not status.devices:
        raise DeviceError(
            f"device {device!r} is not available: {status.reason}. Found: the CPU only; "
            "use device='cpu' or 'auto'"
        )
    names = [device] if isinstance(device, str) else list(device)
    indices = [index] if isinstance(device, str) else [parse_device(name)[1] for name in names]
    for name, wanted in zip(names, indices, strict=True):
        if wanted >= len(status.devices):
            listed = ", ".join(f"cuda:{i} {d['name']}" for i, d in enumerate(status.devices))
            raise DeviceError(f"device {name!r} does not exist; found {listed}; use one of these")
    if len(indices) == 1:
        return Backend(f"cuda:{index}", status.module, index)
    return Backend(f"cuda:{index}", status.module, index, len(indices), tuple(indices))


def select_process(device: str | Sequence[str] = "auto") -> Backend:
    """Return the backend of one process of a job, whose processes share a scene as ranks.

    All of the job call this together. Where no launcher has started this process it is alone.
    "cpu" and "auto" are the CPU; "cuda" is the device with the number of the process on its host,
    or the one that it sees where it sees one alone. What fails for one is a `DeviceError` of all.
    """
    if not isinstance(device, str):
        raise DeviceError(
            f"device is {device!r} and ranks is 'processes', of which each has one device; "
            "expected 'cpu' (or 'auto', which is the CPU here), 'cuda' or 'cuda:<index>'"
        )
    link = Link.of_job(core())
    backend, wrong = None, ""
    try:
        backend = _of_process(device, link)
    except DeviceError as error:
        wrong = str(error)
    told = link.tell([wrong, backend and backend.kind, backend and backend.index])
    for rank, (why, _, _) in enumerate(told):
        if why:
            raise DeviceError(why if link.ranks == 1 else f"rank {rank}: {why}")
    assert backend is not None
    for rank, (_, kind, _) in enumerate(told):
        if kind != told[0][1]:
            raise DeviceError(
                f"rank {rank} is on '{kind}' and rank 0 on '{told[0][1]}'; a scene is shared by "
                "processes on the CPU or by processes on CUDA devices"
            )
    if backend.kind == "cpu" or link.ranks == 1:
        return backend
    _offer_nccl()
    return replace(backend, indices=tuple(int(index) for _, _, index in told))


def _of_process(device: str, link: Link) -> Backend:
    """Return the backend of this process alone, with its link."""
    kind = "cpu" if device == "auto" else parse_device(device)[0]
    if kind == "cpu":
        return Backend("cpu", core(), 0, link.ranks, link=link)
    if device == "cuda" and len(cuda_status().devices) > 1:
        device = f"cuda:{link.local_rank}"
    return replace(select(device), ranks=link.ranks, link=link)


def _offer_nccl() -> None:
    """Name the NCCL among Python's packages to the engine, unless the user has named one."""
    try:
        found = importlib.util.find_spec("nvidia.nccl")
    except ModuleNotFoundError:
        found = None
    for folder in (found.submodule_search_locations if found else None) or ():
        library = Path(folder, "lib", "libnccl.so.2")
        if library.is_file():
            os.environ.setdefault("LIBMPM_NCCL", str(library))
