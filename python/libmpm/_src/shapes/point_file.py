"""`PointFile`: particles at positions from a file."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from libmpm._src.base.declarations import given
from libmpm._src.base.file_digest import file_state
from libmpm._src.base.values import Checker, value
from libmpm._src.errors import SceneError
from libmpm._src.shapes.shape_files import check_file
from libmpm._src.shapes.solid import Array, GivenPoints

__all__ = ["PointFile"]

_ENDINGS = (".npy", ".csv", ".txt", ".xyz")


@value
class PointFile(GivenPoints):
    """Particles at the positions of a file, for bodies.

    {fields}

    All particles of a body have one volume. The scene refers to the file, which must stay where it
    is, unchanged. Raises `SceneError`.
    """

    label: ClassVar[str] = "shapes.PointFile"

    file: str = given(
        ".npy with an array (n, 2 | 3); .csv, .txt or .xyz with a row for every particle, a "
        "line of names allowed",
        range="a path",
    )
    volume: float | None = given(
        "of all particles together (m² in 2D), or", default=None, unit="m³", above=0, scales="mᵈ"
    )
    particle_volume: float | None = given(
        "of each; one of the two", default=None, unit="m³", above=0, scales="mᵈ"
    )
    scale: float = given(
        "factor on the positions of the file", default=1.0, unit="1", above=0, scales="m"
    )
    offset: Sequence[float] | None = given(
        "added to them after that; None = zero", default=None, unit="m", shape="(2|3,)"
    )
    sha256: str | None = given(
        "of the file; None = as it is now, then kept in the scene", default=None, range="64 digits"
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        file, digest = check_file(check, self.file, self.sha256)
        scale = check.given("scale", self)
        given = {}
        for name in ("volume", "particle_volume"):
            one = getattr(self, name)
            if one is not None:
                given[name] = check.number(name, one, lower=0, lower_open=True, unit="m³")
        if len(given) != 1:
            check.fail(
                f"{' and '.join(given) or 'neither volume nor particle_volume'} given; expected "
                "one: volume of all particles together, or particle_volume of each"
            )
        offset = self.offset
        if digest is not None and not check.problems:
            try:
                d = _positions(*file_state(file)).shape[1]
            except SceneError as error:
                check.problems += error.problems
            else:
                offset = (
                    (0.0,) * d
                    if offset is None
                    else check.vector("offset", offset, lengths=(d,), unit="m")
                )
        return {"file": file, "sha256": digest, "scale": scale, "offset": offset, **given}

    @property
    def dimension(self) -> int:
        """Number of axes, 2 or 3."""
        assert self.offset is not None  # checked
        return len(self.offset)

    @property
    def count(self) -> int:
        """Number of particles."""
        return len(_positions(*file_state(self.file)))

    def positions(self) -> Array:
        """Return the positions (n, d), m."""
        found: Array = _positions(*file_state(self.file)) * self.scale + np.asarray(self.offset)
        return found

    def total_volume(self) -> float:
        """Return the volume of all particles, m³ (m² in 2D)."""
        if self.volume is not None:
            return self.volume
        assert self.particle_volume is not None
        return self.particle_volume * self.count


@functools.lru_cache(maxsize=4)
def _positions(path: str, size: int, changed: int) -> Array:
    """Return the positions (n, d) in a file; raises `SceneError`."""
    what, ending = f"shapes.PointFile: file '{path}'", Path(path).suffix.lower()
    if ending not in _ENDINGS:
        raise SceneError(f"{what} ends with '{ending}'; expected one of {', '.join(_ENDINGS)}")
    try:
        found = np.load(path, allow_pickle=False) if ending == ".npy" else _text(path, ending)
        found = np.array(found, dtype=np.float64)
    except (OSError, ValueError, UnicodeDecodeError) as error:
        raise SceneError(f"{what} cannot be read: {error}") from error
    if found.ndim != 2 or found.shape[1] not in (2, 3) or len(found) == 0:
        raise SceneError(
            f"{what} has an array of shape {found.shape}; expected (n, 2) or (n, 3), a row of "
            "coordinates for every particle; leave other columns out"
        )
    bad = np.flatnonzero(~np.isfinite(found).all(axis=1))
    if len(bad):
        raise SceneError(
            f"{what}: {len(bad)} rows are not finite, the first is row {bad[0]}; expected numbers "
            "in m; remove them"
        )
    found.setflags(write=False)
    return found


def _text(path: str, ending: str) -> Array:
    delimiter = "," if ending == ".csv" else None
    with open(path, encoding="utf-8") as file:
        words = file.readline().replace(",", " ").split()
    try:
        named = not [float(word) for word in words]
    except ValueError:
        named = not words[0].startswith("#")
    return np.loadtxt(path, delimiter=delimiter, skiprows=int(named), ndmin=2)
