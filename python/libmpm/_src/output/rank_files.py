"""The output folder of ranks that are processes: rank 0 writes it, all write parts of frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from libmpm._src.output import checkpoint as checkpoints
from libmpm._src.output import frames
from libmpm._src.output.atomic_files import writing
from libmpm._src.output.settings import Output
from libmpm._src.output.writer import Writer

if TYPE_CHECKING:
    from libmpm._src.run.rank_messages import Link
    from libmpm._src.run.running import Running

__all__ = ["open_together"]


def open_together(link: Link, output: Output, simulation: Running, *, resumed: bool) -> Writer:
    """Return the writer of this process; all ranks together."""
    writer: _First | _Other
    if link.first:
        writer = _First(link, output, simulation, resumed=resumed)
    else:
        writer = _Other(link, output, simulation)
    writer.agree()
    return writer


class _OfRanks(Writer):
    """What all ranks have alike: when something is due, and their parts of frames."""

    _link: Link

    def agree(self) -> None:
        """Take up rank 0's word on what is due next: it has looked into the folder."""
        self._next_frame, self._next_checkpoint = self._link.tell(
            [self._next_frame, self._next_checkpoint]
        )[0]

    def _put_frame(
        self,
        body: str,
        index: int,
        position: NDArray[np.float64],
        attributes: Mapping[str, NDArray[Any]],
        metadata: Mapping[str, Any],
        real: type,
        elements: NDArray[Any] | None,
    ) -> None:
        link = self._link
        if elements is not None:
            self._put_mesh(body, index, position, attributes, metadata, real, elements)
            return
        paths = [frames.part_path(self._frames, body, index, r) for r in range(link.ranks)]
        frames.write_frame(paths[link.rank], position, attributes, metadata, real=real)
        counts = link.tell(len(position))
        if link.first:
            path = frames.frame_path(self._frames, body, index)
            frames.write_index(path, paths, counts, metadata)

    def _put_mesh(
        self,
        body: str,
        index: int,
        position: NDArray[np.float64],
        attributes: Mapping[str, NDArray[Any]],
        metadata: Mapping[str, Any],
        real: type,
        elements: NDArray[Any],
    ) -> None:
        """Write a body of elements as one process does: its elements name rows of all ranks."""
        mine = self._simulation.particles[body]["id"]
        rows = [name for name in attributes if frames.of_elements(name)]
        whole = self._link.gather({"id": mine, "position": position, **attributes}, rows)
        if whole is None:
            return
        order = np.argsort(whole.pop("id"))
        arrays = {
            name: array if frames.of_elements(name) else array[order]
            for name, array in whole.items()
        }
        path = frames.frame_path(self._frames, body, index)
        place = arrays.pop("position")
        frames.write_frame(path, place, arrays, metadata, real=real, elements=elements)


class _First(_OfRanks):
    """Of rank 0: as of one process."""

    def __init__(self, link: Link, output: Output, simulation: Running, *, resumed: bool) -> None:
        super().__init__(output, simulation, resumed=resumed)
        self._link = link
        if output.frame_interval:
            with writing(self._frames):
                (self._frames / "parts").mkdir(exist_ok=True)


class _Other(_OfRanks):
    """Of any other rank: nothing but its parts of frames."""

    def __init__(self, link: Link, output: Output, simulation: Running) -> None:
        self._link = link
        self.output = output
        self._simulation = simulation
        self._folder = output.path.absolute()
        self._frames = self._folder / "frames"
        self._checkpoints = self._folder / "checkpoints"
        self._last_flush = 0.0
        self._next_frame = self._next_checkpoint = 0

    def _list_frame(self, body: str, index: int) -> None:
        pass

    def checkpoint(self) -> Path:
        path = checkpoints.checkpoint_path(self._checkpoints, self._simulation.steps)
        self._simulation.save_checkpoint(path)
        return path

    def flush(self) -> None:
        pass

    def removed(self, rows: Sequence[Sequence[Any]]) -> None:
        pass

    def export_csv(self) -> list[Path]:
        return []

    def log(self, status: str, message: str = "") -> None:
        pass

    def finish(self, status: str, message: str = "") -> None:
        pass

    def close(self) -> None:
        pass
