"""`animate`: films of a run, from the frames in its folder."""

from __future__ import annotations

import contextlib
import importlib
import os
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib import animation
from matplotlib.colors import Normalize
from numpy.typing import NDArray

from libmpm._src.base.values import keywords_only, nearest, shown
from libmpm._src.errors import Error, ModelWarning, OutputError, SceneError
from libmpm._src.output.earlier_run import document_of
from libmpm._src.output.frames import frame_time, list_frames, read_frame, read_series
from libmpm._src.output.reading_files import is_cut
from libmpm._src.pictures import figures as common
from libmpm._src.pictures.instruments import legend_of_sensors
from libmpm._src.pictures.panel import Dots, Panel, height_of, legend_of, width_of
from libmpm._src.pictures.plot import LEGEND, bodies_of, chosen_colour
from libmpm._src.pictures.preview import vertical_of
from libmpm._src.scene.scene import Scene

__all__ = ["RunFrames", "animate"]

Array = NDArray[np.float64]

#: Frames that are looked at to choose the range of colours.
_LOOKED_AT = 25


def _not_cut(files: Mapping[int, Path]) -> dict[int, Path]:
    """Return the frames of a body without empty and cut ones, which a warning names."""
    cut = {i for i, path in files.items() if is_cut(path)}
    if cut:
        more = f" (and {len(cut) - 1} more)" if len(cut) > 1 else ""
        warnings.warn(
            f"{files[min(cut)]}{more}: is empty or cut short; it is left out of pictures",
            ModelWarning, stacklevel=4,
        )  # fmt: skip
    return {i: path for i, path in files.items() if i not in cut}


class RunFrames:
    """The frames of a run's folder, read one at a time."""

    def __init__(self, folder: Path, bodies: Sequence[str] | str | None, most: int) -> None:
        document, problem = document_of(folder)
        if document is None:
            raise SceneError(
                f"{folder} has no scene.json that can be read; expected the output folder of a run "
                f"({problem})"
            )
        if problem:
            warnings.warn(f"{problem}: it is taken", ModelWarning, stacklevel=3)
        self.scene = Scene.from_dict(document)
        found = {name: _not_cut(files) for name, files in list_frames(folder / "frames").items()}
        self.bodies = [n for n in bodies_of(self.scene, bodies) if found.get(n)]
        if not self.bodies:
            raise Error(f"{folder} has no frames of these bodies; run with output=libmpm.Output("
                        "folder, frame_interval=...)")  # fmt: skip
        self._files = {name: found[name] for name in self.bodies}
        self._wanted = bodies
        self.indices = sorted({i for files in self._files.values() for i in files})
        self._times: dict[int, float] = {}
        for name in self.bodies:
            self._times |= read_series(folder / "frames", name)
        self._most = most

    @classmethod
    def of(cls, folder: Path) -> RunFrames | None:
        """Return the frames of all bodies of a folder; None where it has none."""
        return cls(folder, None, common.MOST) if list_frames(folder / "frames") else None

    def time(self, index: int) -> float:
        """Return the simulated time of a frame, s."""
        if index not in self._times:
            file = next(files[index] for files in self._files.values() if index in files)
            self._times[index] = frame_time(file)
        return self._times[index]

    def attributes(self) -> list[str]:
        """Return the names that the first frame has."""
        names: dict[str, None] = {}
        for files in self._files.values():
            arrays, _ = read_frame(files[min(files)])
            names |= dict.fromkeys(arrays)
        return list(names)

    def dots(self, index: int, colour: str | None) -> tuple[dict[str, Dots], int]:
        """Return what is drawn of a frame, and how many particles it has."""
        found = {n: read_frame(f[index])[0] for n, f in self._files.items() if index in f}
        counts = [len(arrays["position"]) for arrays in found.values()]
        dots = {}
        shares = common.shares(counts, self._most)
        coloured = chosen_colour(self.scene, self.bodies, colour, self._wanted)
        for (name, arrays), count, share in zip(found.items(), counts, shares, strict=True):
            rows = common.chosen(count, share)
            chosen = {key: values[rows] for key, values in arrays.items()}
            position = np.asarray(chosen["position"][:, : self.scene.dimension])
            numbers = self._colour(chosen, colour if name in coloured else None)
            dots[name] = Dots(position, numbers, len(rows) / max(count, 1))
        return dots, sum(counts)

    @staticmethod
    def _colour(arrays: Mapping[str, NDArray[Any]], colour: str | None) -> Array | None:
        if colour is None:
            return None
        if colour in arrays:
            return common.colours_of(arrays, colour)
        if colour == "speed" and "velocity" in arrays:
            return np.asarray(np.linalg.norm(arrays["velocity"], axis=1))
        name, _ = common.split_name(colour)
        return common.colours_of(arrays, colour) if name in arrays else None


def _check_colour(run: RunFrames, colour: str | None) -> None:
    if colour is None:
        return
    known = run.attributes()
    name, _ = common.split_name(colour)
    if colour in known or name in known or (colour == "speed" and "velocity" in known):
        return
    raise Error(f"colour is {shown(colour)}, which the frames do not have; "
                f"{nearest(colour, known)}; Output(attributes=...) chooses what frames "
                "store")  # fmt: skip


def _limits(run: RunFrames, indices: Sequence[int], colour: str | None) -> tuple[float, float]:
    picks = indices[:: max(1, -(-len(indices) // _LOOKED_AT))]
    values = []
    for index in picks:
        dots, _ = run.dots(index, colour)
        values += [d.colour for d in dots.values() if d.colour is not None]
    return common.limits_of(values)


@contextlib.contextmanager
def _writer(path: Path, fps: float) -> Iterator[Any]:
    """Yield what writes a file of this kind; raises `Error` naming what is missing."""
    kind = path.suffix.lower()
    # Their annotations want a whole number; they take any.
    pillow: Any = animation.PillowWriter
    ffmpeg: Any = animation.FFMpegWriter
    if kind == ".gif":
        yield pillow(fps=fps)
        return
    if kind not in (".mp4", ".webm", ".mov", ".mkv"):
        raise Error(f"{path.name} ends in {path.suffix!r}; expected .gif, .mp4, .mov, .mkv, .webm")
    settings: Any = {}
    if not animation.writers.is_available("ffmpeg"):
        try:
            carrier = importlib.import_module("imageio_ffmpeg")
            settings["animation.ffmpeg_path"] = carrier.get_ffmpeg_exe()
        except (ImportError, RuntimeError):
            raise Error(
                f"{path.name}: no program ffmpeg is found, nor the package imageio-ffmpeg that "
                "brings one; run `pip install libmpm[viz]`, install ffmpeg, or write a .gif"
            ) from None
    with matplotlib.rc_context(settings):
        codec = "libvpx-vp9" if kind == ".webm" else "h264"
        yield ffmpeg(fps=fps, codec=codec, extra_args=["-loglevel", "error"])


@keywords_only("animate", 2, method=False, renamed={"color": "colour"})
def animate(
    run: str | os.PathLike[str] | Any,
    path: str | os.PathLike[str],
    *,
    colour: str | None = "speed",
    bodies: Sequence[str] | str | None = None,
    plane: str | None = None,
    limits: tuple[float, float] | None = None,
    fps: float = 20.0,
    every: int = 1,
    most: int = common.MOST,
    width: float = 9.0,
    dpi: int = 110,
) -> Path:
    """Write a film of a run's frames as GIF or MP4 and return its path.

    =========  ======  ===========  ==============================================================
    parameter  unit    range        meaning
    =========  ======  ===========  ==============================================================
    run        -       a folder     of a run with frames (`Output.frame_interval`)
    path       -       a file       .gif, or .mp4, .mov, .mkv, .webm where there is an ffmpeg
    colour     -       a name       attribute of the frames, such as "pressure" or "velocity_x";
                                    None = one colour. Bodies without it are grey
    bodies     -       names        None = all that have frames
    plane      -       a name       such as "xz", or "3d" from above a corner; None = the elevation
    limits     its     low < high   range of the colours in all frames; None = all but the
               unit                 outermost half percent of some frames
    fps        1/s     > 0          frames per second of the film
    every      1       ≥ 1          1 takes all frames, 2 every second one
    most       1       ≥ 1          particles drawn, always the same ones; the title says it where
                                    that is not all
    width      inches  > 0          width of the picture
    dpi        1/inch  ≥ 10         dots per inch
    =========  ======  ===========  ==============================================================

    A frame stands for its simulated time, which is written above it. The file appears when it is
    whole. Raises `Error`, and `OutputError` where it cannot be written.
    """
    folder = Path(getattr(run, "path", run))
    target = Path(path)
    for name, number, least in (("fps", fps, 0), ("width", width, 0), ("every", every, 1),
                                ("dpi", dpi, 10)):  # fmt: skip
        if not number >= least or number == 0:
            raise Error(f"{name} is {shown(number)}; expected {'>' if least == 0 else '≥'} {least}")
    frames = RunFrames(folder, bodies, most)
    _check_colour(frames, colour)
    indices = frames.indices[:: int(every)]
    names = common.planes_of(frames.scene.dimension, plane, vertical_of(frames.scene))
    low, high = _limits(frames, indices, colour) if limits is None else common.check_limits(limits)
    with _writer(target, fps) as writer:
        film = _Film(frames, names[0], colour, Normalize(low, high), width)
        part = target.with_name(f".{target.stem}.part{target.suffix}")
        try:
            with writer.saving(film.picture, str(part), dpi):
                for index in indices:
                    film.show(index)
                    writer.grab_frame()
            os.replace(part, target)
        except OSError as error:
            raise OutputError(f"cannot write {target}: {error}") from error
        finally:
            part.unlink(missing_ok=True)
    return target


class _Film:
    """One picture whose particles move."""

    def __init__(
        self, run: RunFrames, plane: str, colour: str | None, norm: Normalize, width: float
    ) -> None:
        self._run, self._colour_by = run, colour
        scene = run.scene
        vertical = vertical_of(scene)
        width = width_of(scene, [plane], width)
        height = height_of(scene, plane, width) + LEGEND
        self.picture = common.Picture(figsize=(width, height), layout="constrained")
        self._axes = self.picture.add_subplot()
        self._panel = Panel(
            self._axes, scene, plane, vertical, bodies=run.bodies, norm=norm, later=True
        )
        self._dots = self._panel.bodies
        self._bar = colour is None
        self._named = False

    def show(self, index: int) -> None:
        """Draw a frame."""
        dots, count = self._run.dots(index, self._colour_by)
        image = self._panel.show(dots)
        if image is not None and not self._bar and self._colour_by is not None:
            self._bar = True
            self.picture.colorbar(image, ax=self._axes, label=common.label_of(self._colour_by),
                                  shrink=0.85)  # fmt: skip
        plain = self._panel.plain(dots)
        if not self._named:
            self._named = True
            bodies = legend_of(plain if len(self._dots) > 1 else {})
            sensors = legend_of_sensors(self._run.scene)
            handles, texts = (a + b for a, b in zip(bodies, sensors, strict=True))
            common.legend_below(self.picture, handles, texts)
        drawn = sum(map(len, dots.values()))
        said = [self._run.scene.name, f"{self._run.time(index):.3f} s", common.note(drawn, count)]
        title = common.title_of(self.picture, said, 10)
        self._axes.set_title(title, fontsize=10, loc="left")
