"""What is installed and what it can use."""

from __future__ import annotations

from typing import Any

from libmpm._src import backends

__all__ = ["collect", "describe"]


def collect() -> dict[str, Any]:
    """Return version, builds, devices, threads, instruction set, and why CUDA is unavailable."""
    build = dict(backends.core().build_info())
    cuda = backends.cuda_status()
    return {
        **build,
        "backends": ["cpu"] + (["cuda"] if cuda.module is not None else []),
        "cuda_build": dict(cuda.module.build_info()) if cuda.module is not None else None,
        "devices": [dict(d) for d in cuda.devices],
        "cuda_unavailable": cuda.reason or None,
    }


def _join(values: Any) -> str:
    return ", ".join(str(v) for v in values)


def describe() -> str:
    """Return the same as text."""
    found = collect()
    openmp = "OpenMP" if found.get("openmp") else "no OpenMP"
    rows = [
        ("libmpm", found["version"]),
        ("compiler", found.get("compiler", "unknown")),
        ("backends", _join(found["backends"])),
        ("dimensions", _join(found["dimensions"])),
        ("precisions", _join(found["precisions"])),
        ("materials", _join(found["materials"])),
        ("CPU", f"{found['threads']} threads ({openmp}), {found['instruction_set']}"),
    ]
    for device in found["devices"]:
        rows.append(
            (
                f"cuda:{device['index']}",
                f"{device['name']}, {device['memory'] / 2**30:.1f} GiB "
                f"({device['free'] / 2**30:.1f} free), compute capability "
                f"{device['compute_capability']}",
            )
        )
    if found["cuda_build"]:
        build = found["cuda_build"]
        architectures = _join(build.get("architectures", []))
        rows.append(("CUDA", f"runtime {build.get('cuda_runtime')}, {architectures}"))
    if found["cuda_unavailable"]:
        rows.append(("CUDA", f"not available: {found['cuda_unavailable']}"))
    return "\n".join(f"{name:<11} {text}" for name, text in rows)
