"""Choice of the compiled module and device that run a simulation."""

from __future__ import annotations

import functools
import importlib
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from libmpm._src.errors import DeviceError, Error
from libmpm._src.processes import Link

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

    `ranks` share a scene, each with its own part of it; on CUDA `indices` are their devices and
    `name` is that of the first. Where they are processes, `link` is what this one tells the others
    through.
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
    """Return the bytes that a device can still give, or None where that cannot be told."""
    if backend.kind == "cuda":
        found = backend.module.devices()
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
        if len(device) > 0 and all(name == "cpu" for name in device):
            return ("cpu", 0)
        if len(device) > 0 and all(re.fullmatch("cuda(:[0-9]+)?", str(name)) for name in device):
            return parse_device(device[0])
        raise DeviceError(
            f"device is {device!r}: several devices share a scene where all are 'cpu' "
            "(['cpu', 'cpu']) or all are CUDA devices (['cuda:0', 'cuda:1'])"
        )
    if device == "auto":
        return ("cuda" if cuda_status().devices else "cpu", 0)
    match = re.fullmatch(r"cpu|cuda(?::([0-9]+))?", device)
    if match is None:
        raise DeviceError(f"device is {device!r}; expected 'auto', 'cpu', 'cuda' or 'cuda:<index>'")
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
    Raises `DeviceError`.
    """
    if device not in ("auto", "cpu"):
        raise DeviceError(
            f"device is {device!r} and ranks is 'processes'; expected device 'cpu' (or 'auto', "
            "which is the CPU here). On CUDA devices of one host, name them: "
            "device=['cuda:0', 'cuda:1']"
        )
    module = core()
    link = Link.of_job(module)
    return Backend("cpu", module, 0, link.ranks, link=link)
