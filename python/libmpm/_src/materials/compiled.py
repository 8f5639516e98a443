"""`materials.from_header`: a custom law, a short C++ header compiled at run time.

The header is what `include/mpm/physics/material/*.hpp` are (docs/extending.md): the compiler makes
of it the instances that a built-in law has, in a shared library that is kept in a folder and loaded
into this process.
"""

from __future__ import annotations

import fcntl
import hashlib
import importlib
import math
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from libmpm._src.base.arguments import keywords_only
from libmpm._src.base.log import LOG
from libmpm._src.base.values import shown, value
from libmpm._src.errors import Error, SceneError
from libmpm._src.materials.material import Column, Entry, Material, Parameter

__all__ = ["device_for", "find_nvcc", "from_header", "load_on_devices"]

#: As of the library itself (cmake/MpmFlags.cmake): the same formula gives the same bits.
_ARITHMETIC = (
    "-ffp-contract=fast", "-fno-math-errno", "-fno-trapping-math", "-fno-signed-zeros", "-fPIC",
    "-fvisibility=hidden", "-fvisibility-inlines-hidden", "-Wno-psabi",
)  # fmt: skip
_COMMON = ("-std=c++20", "-O3", "-DNDEBUG", "-DEIGEN_MAX_STATIC_ALIGN_BYTES=16", "-shared")
FLAGS = {
    "cpu": (*_COMMON, *_ARITHMETIC, "-fopenmp", "-Wall", "-Wextra"),
    "cuda": (*_COMMON, "--expt-relaxed-constexpr", "-Xcompiler=" + ",".join(_ARITHMETIC)),
}

_UNIT = {
    "cpu": """#include "mpm/kernels/cpu/added_material.hpp"
#include "law.hpp"
MPM_ADDED_MATERIAL(mpm::{name})
""",
    "cuda": """#include "mpm/kernels/cuda/added_material.cuh"
#include "law.hpp"
MPM_ADDED_CUDA_MATERIAL(mpm::{name})
""",
}


@dataclass
class _Loaded:
    """A law that this process has."""

    text: str
    key: str
    made: type[Material]
    folder: Path
    on_devices: bool = False


_LOADED: dict[str, _Loaded] = {}


@keywords_only("materials.from_header", 1, method=False)
def from_header(
    header: str | Path, *, compiler: str | None = None, cache: str | Path | None = None
) -> type[Material]:
    """Compile a material from a C++ header, and return its class.

    Parameters
    ----------
    header
        A file, or the text itself, with a struct in namespace ``mpm`` that is named as its ``name``
        says, and has the members that docs/extending.md lists.
    compiler
        The C++20 compiler; None takes the environment's ``CXX``, else ``c++`` or ``g++``.
    cache
        Folder of compiled laws; None takes the environment's ``LIBMPM_CACHE``, else
        ``~/.cache/libmpm``. The same header, version, compiler and flags are compiled once.

    A law compiles in about half a minute; with ``static constexpr bool fused = false``, which
    leaves it to the phased pipeline, in some seconds. The class is like those of
    `libmpm.materials`: keyword arguments by the header's table of parameters, checked by its
    ranges, in SI units. A process that reads a scene file with it, a worker of a study say, calls
    this first. The first simulation with it on a CUDA device compiles it for that, by ``nvcc``;
    without one it is refused by name, and device "auto" is the CPU.

    Raises `SceneError` for a header without its name, whose name is taken, or that does
    not compile (with what the compiler says), and `Error` without a compiler or its headers.
    """
    for what, given in (("header", header), ("compiler", compiler), ("cache", cache)):
        if not isinstance(given, str | Path) and (given is not None or what == "header"):
            raise SceneError(f"materials.from_header: {what} is {shown(given)}; expected a path")
    text = _text(header)
    name = _name(text)
    found = _compiler(compiler, name)
    command = [found, *FLAGS["cpu"]]
    key = _key(text, command, _UNIT["cpu"])
    if name in _LOADED:
        if _LOADED[name].key == key:
            return _LOADED[name].made
        raise SceneError(
            f"material '{name}' has been compiled from another header in this process; expected "
            "one law of a name; give it another name, or begin a new process"
        )
    if hasattr(importlib.import_module("libmpm._src.materials.generated"), name):
        raise SceneError(f"material '{name}' is built in; expected another name for a custom law")
    folder = _folder(cache)
    core = importlib.import_module("libmpm._core")
    core.add_material(str(_library(name, text, "cpu", command, key, folder)))
    entry = next(m for m in core.material_table() if m["name"] == name)
    made = _class(entry)
    _LOADED[name] = _Loaded(text, key, made, folder)
    return made


def find_nvcc() -> str | None:
    """Return the CUDA compiler: the environment's ``CUDACXX``, ``nvcc``, or where it usually is."""
    homes = [os.environ.get(name) for name in ("CUDA_PATH", "CUDA_HOME")]
    places = [f"{home}/bin/nvcc" for home in [*homes, "/usr/local/cuda"] if home]
    for one in [os.environ.get("CUDACXX"), "nvcc", *places]:
        path = shutil.which(one) if one else None
        if path:
            return path
    return None


def device_for(bodies: Mapping[str, str], device: str | Sequence[str]) -> str | Sequence[str]:
    """Return the device of a scene with such laws, name of the body -> label of its law.

    Without the compiler of CUDA devices "auto" is the CPU, and a CUDA device refused by name.
    """
    if find_nvcc() is not None:
        return device
    if "cuda" in str(device):
        body, label = next(iter(bodies.items()))
        raise Error(
            f"body '{body}': {label} was compiled at run time, which on a CUDA device needs nvcc; "
            "none is on PATH, nor named by CUDACXX; install the CUDA toolkit, or use device='cpu'"
        )
    return "cpu" if device == "auto" else device


def load_on_devices(name: str, module: Any, capability: str) -> None:
    """Compile a law for CUDA devices of a capability ("9.0"), once, and give it to their module."""
    law = _LOADED[name]
    if law.on_devices:
        return
    nvcc = find_nvcc()
    assert nvcc is not None
    command = [nvcc, *FLAGS["cuda"], f"-arch=sm_{capability.replace('.', '')}"]
    key = _key(law.text, command, _UNIT["cuda"])
    module.add_material(str(_library(name, law.text, "cuda", command, key, law.folder)))
    law.on_devices = True


def _text(header: str | Path) -> str:
    if isinstance(header, str) and "\n" in header:
        return header
    try:
        return Path(header).read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise SceneError(
            f"header {shown(str(header))} cannot be read: {error}; expected a C++ header, or its "
            "text"
        ) from error


def _name(text: str) -> str:
    said = re.search(r'static\s+constexpr\s+const\s+char\s*\*\s*name\s*=\s*"(\w+)"', text)
    if said is None or not re.search(rf"\bstruct\s+{said[1]}\b", text):
        raise SceneError(
            "the header of a material does not define its name; expected a struct in namespace mpm "
            'with `static constexpr const char* name = "Law";` that is called Law itself'
        )
    return said[1]


def _compiler(wanted: str | None, name: str) -> str:
    tried = [wanted] if wanted else [os.environ.get("CXX") or "c++", "c++", "g++"]
    for one in tried:
        path = shutil.which(one) if one else None
        if path:
            return path
    raise Error(
        f"material '{name}' needs a C++20 compiler, and {', '.join(map(repr, tried))} is not "
        "found; install g++ (Debian: apt install g++), or name one: compiler='/path/to/g++'"
    )


def _headers(name: str) -> Path:
    package = Path(__file__).resolve().parents[2]
    for folder in (package / "include", package.parents[1] / "include"):
        if (folder / "mpm/kernels/cpu/added_material.hpp").is_file():
            return folder
    raise Error(
        f"material '{name}' needs libmpm's headers, and {package / 'include'} does not hold them; "
        "install libmpm from its wheel or its source"
    )


def _eigen(name: str) -> Path:
    prefix = Path(sysconfig.get_path("platlib")) / "cmeel.prefix/include/eigen3"
    said = os.environ.get("LIBMPM_EIGEN_INCLUDE")
    for folder in ([Path(said)] if said else []) + [prefix, Path("/usr/include/eigen3")]:
        if (folder / "Eigen/Core").is_file():
            return folder
    raise Error(
        f"material '{name}' needs the headers of Eigen, which {prefix} does not hold; "
        "pip install 'libmpm[compile]', or set LIBMPM_EIGEN_INCLUDE"
    )


def _key(text: str, command: list[str], unit: str) -> str:
    """Return what tells apart all that a compiled law is made of."""
    core = importlib.import_module("libmpm._core")
    asked = subprocess.run([command[0], "--version"], capture_output=True, text=True, check=False)
    digest = hashlib.sha256()
    for part in (text, asked.stdout, str(core.build_info()["version"]), *command[1:], unit):
        digest.update(part.encode() + b"\0")
    headers = _headers(_name(text))
    for file in sorted([*headers.rglob("*.hpp"), *headers.rglob("*.cuh")]):
        digest.update(file.read_bytes())
    return digest.hexdigest()[:20]


def _folder(cache: str | Path | None) -> Path:
    home = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    folder = Path(cache or os.environ.get("LIBMPM_CACHE") or Path(home) / "libmpm") / "materials"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        raise Error(
            f"the folder of compiled materials {folder} cannot be made: {error}; give another: "
            "cache='folder', or LIBMPM_CACHE"
        ) from error
    return folder


def _library(name: str, text: str, kind: str, command: list[str], key: str, folder: Path) -> Path:
    """Return the compiled library of a law, made where it is not there yet."""
    library = folder / f"{name}-{kind}-{key}.so"
    with open(library.with_suffix(".lock"), "w", encoding="ascii") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # processes of a study wait for the first of them
        if not library.is_file():
            _compile(name, text, kind, command, library)
    return library


def _compile(name: str, text: str, kind: str, command: list[str], library: Path) -> None:
    LOG.info("material %s is compiled by %s; once, some tens of seconds", name, command[0])
    version = importlib.import_module("libmpm._core").build_info()["version"]
    with tempfile.TemporaryDirectory(dir=library.parent) as place:
        work = Path(place)
        (work / "law.hpp").write_text(text, encoding="utf-8")
        unit, made = work / ("law.cpp" if kind == "cpu" else "law.cu"), work / "law.so"
        unit.write_text(_UNIT[kind].format(name=name), encoding="utf-8")
        command = [*command, f'-DLIBMPM_VERSION="{version}"', f"-I{_headers(name)}", f"-I{work}"]
        command += ["-isystem", str(_eigen(name)), str(unit), "-o", str(made)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            said = [line for line in done.stderr.splitlines() if "error" in line] or [done.stderr]
            raise SceneError(
                f"material '{name}' does not compile: " + "; ".join(said[:3])[:1500] + "; "
                "expected the members that docs/extending.md lists; correct the header"
            )
        os.replace(made, library)


def _class(entry: dict[str, Any]) -> type[Material]:
    """Return the class of an entry of the core's table, as those in `generated` are written."""
    parameters = tuple(Parameter(**p) for p in entry["parameters"])
    keys = ("name", "components", "meaning", "unit")
    columns = tuple(Column(**{key: c[key] for key in keys}) for c in entry["columns"])
    texts = {key: str(entry[key]) for key in ("name", "summary", "source", "needs")}
    table = Entry(**texts, columns=columns, fbar=bool(entry["fbar"]), parameters=parameters)
    space: dict[str, Any] = {
        "__doc__": _documentation(table),
        "__module__": __name__,
        "__annotations__": {p.name: float for p in parameters},
        "label": f"materials.{table.name}",
        "table": table,
        "added": True,
    }
    for p in parameters:
        if p.default is not None and not math.isnan(p.default):
            space[p.name] = p.default
    made: type[Material] = value(type(table.name, (Material,), space))
    # So that a scene can be pickled where the law has been compiled.
    setattr(sys.modules[__name__], table.name, made)
    return made


def _documentation(table: Entry) -> str:
    lines = [f"{table.summary}.", ""]
    for p in table.parameters:
        default = "required" if p.default is None else f"default {p.default:g}"
        lines.append(f"{p.name} ({p.symbol}, {p.unit}, {p.range}, {default}): {p.meaning}.")
    stored = ", ".join(f"{c.name} ({c.meaning})" for c in table.columns)
    return "\n".join([*lines, "", f"Particles store: {stored}.", f"Source: {table.source}."])
