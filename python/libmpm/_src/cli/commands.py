"""The commands of `libmpm`; `docs/command-line.md` is their page."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import enum
import json
import os
import signal
import sys
import time as clock
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from libmpm._src.cli.options import parser
from libmpm._src.errors import (
    CapacityError,
    CheckpointError,
    DeviceError,
    Error,
    ModelWarning,
    NumericalError,
    OutputError,
    SceneError,
)

if TYPE_CHECKING:
    from libmpm._src.run.partition import Partition
    from libmpm._src.scene.scaling import Scaling

__all__ = ["EXIT_CODES", "ExitCode", "main"]


class ExitCode(enum.IntEnum):
    """What the process returns; a scheduler decides by it what to do with the job."""

    #: Everything that was asked for is done.
    DONE = 0
    #: An error that libmpm does not expect; its traceback is on stderr.
    UNEXPECTED = 1
    #: Arguments, a scene or a checkpoint that cannot be used; the same job will fail again.
    INPUT = 2
    #: The state became unusable, or some cases of a study failed.
    NUMERICAL = 3
    #: A result cannot be written; continue from the last checkpoint once there is space.
    OUTPUT = 4
    #: No such device, or not enough memory.
    DEVICE = 5
    #: Stopped by the wall-clock limit or a batch system's signal, with a checkpoint written:
    #: submit the job again with ``libmpm resume`` or ``libmpm run --continue``.
    STOPPED = 6
    #: Stopped by Ctrl-C.
    INTERRUPTED = 130


#: Exception -> exit code of the process.
EXIT_CODES: dict[type[Error], ExitCode] = {
    SceneError: ExitCode.INPUT,
    CheckpointError: ExitCode.INPUT,
    NumericalError: ExitCode.NUMERICAL,
    OutputError: ExitCode.OUTPUT,
    DeviceError: ExitCode.DEVICE,
    CapacityError: ExitCode.DEVICE,
}

#: Commands that SIGTERM and SIGUSR1 stop at a step, with a checkpoint and code 6.
_STEPPING = ("demo", "flume", "run", "resume")


def _execution(arguments: argparse.Namespace) -> dict[str, Any]:
    names = ("precision", "pipeline", "threads")
    chosen = {name: getattr(arguments, name) for name in names}
    return chosen | {"device": _device(arguments.device)}


def _device(text: str) -> str | list[str]:
    """Return one device, or those between commas."""
    return text.split(",") if "," in text else text


def _partition(arguments: argparse.Namespace, path: Path | None = None) -> Partition | None:
    """Return the partition that was asked for, the rest from a checkpoint; None for neither."""
    names = ("cuts", "at", "by", "weights", "rebalance_above")
    given = {name: getattr(arguments, name) for name in names}
    given = {name: word for name, word in given.items() if word is not None}
    if not given:
        return None
    from libmpm._src.run.partition import Partition

    kept: dict[str, Any] = {}
    if path is not None:
        from libmpm._src.output import checkpoint

        header, _ = checkpoint.find_newest(path, checkpoint.load_header)[1]
        kept = {k: v for k, v in (header.get("partition") or {}).items() if k != "type"}
    # Both say where ranks begin.
    for name, other in (("at", "by"), ("by", "at")):
        if name in given:
            kept.pop(other, None)
    return Partition(**(kept | given))


def _scaling(arguments: argparse.Namespace) -> Scaling | None:
    """Return the scaling that was asked for, or None."""
    ratio = getattr(arguments, "scale", None)
    if ratio is None:
        for name in ("cauchy", "reynolds"):
            if getattr(arguments, name, False):
                raise SceneError(f"--{name} without --scale; expected a length ratio; add it")
        return None
    from libmpm._src.scene.scaling import Scaling

    return Scaling(ratio, arguments.cauchy, arguments.reynolds)


def _source(arguments: argparse.Namespace) -> Any:
    """Return the scene file, scaled if that was asked for."""
    from libmpm._src.scene.run_file import read_run_file, scale_run_file

    source, scaling = read_run_file(arguments.file), _scaling(arguments)
    return source if scaling is None else scale_run_file(source, scaling)


def _until(stated: float | None, recorded: float | None) -> float:
    until = recorded if stated is None else stated
    if until is None:
        raise SceneError('the end is not stated: pass --until, or give "until" in the "run" key')
    return until


def _finish(simulation: Any, until: float, arguments: argparse.Namespace) -> int:
    from libmpm._src.run.runner import run_to_end

    limit = arguments.wall_limit
    if limit is not None:
        limit = max(0.0, limit - (clock.monotonic() - arguments.began))
    text = run_to_end(
        simulation,
        until,
        progress=not arguments.quiet,
        picture=not arguments.no_picture,
        wall_limit=limit,
    )
    print(text)
    return ExitCode.STOPPED if simulation.stopped else ExitCode.DONE


def _demo(arguments: argparse.Namespace) -> int:
    from libmpm._src.cli.demo import load_demo

    # The folder is the demonstration's own unless the user names one that holds other results.
    return _run_source(load_demo(), arguments, overwrite=arguments.output == Path("libmpm-demo"))


def _run(arguments: argparse.Namespace) -> int:
    source = _source(arguments)
    if not arguments.go_on:
        return _run_source(source, arguments, overwrite=arguments.overwrite)
    from libmpm._src.output.folder_lock import held_folder

    # What the folder holds is read while nobody else can change it.
    with held_folder(arguments.output):
        return _run_source(source, arguments, overwrite=False, go_on=True)


def _run_source(
    source: Any, arguments: argparse.Namespace, *, overwrite: bool, go_on: bool = False
) -> int:
    from libmpm._src.run.runner import start
    from libmpm._src.scene.run_file import without_debris

    if arguments.without_debris:
        source = without_debris(source)
    until = _until(arguments.until, source.settings.until)
    folder = arguments.output
    if go_on and (folder / "log.json").is_file():
        from libmpm._src.output.results import Results

        results = Results(folder)
        if results.scene != source.scene:
            raise SceneError(
                f"{folder} holds the run of another scene; expected that of {arguments.file}; "
                "choose another folder, or pass --overwrite"
            )
        log = results.log
        if log.get("status") in ("finished", "stopped") and log.get("time", 0.0) >= until:
            print(f"{folder}: finished at {log['time']:g} s; nothing to do")
            return ExitCode.DONE
        if results.checkpoints:
            return _go_on(folder, None, until, arguments)
        # What was cut off before its first checkpoint has nothing to continue from.
        overwrite = True
    simulation = start(
        source, folder, overwrite=overwrite, guard=not arguments.no_guard,
        partition=_partition(arguments), **_execution(arguments),
    )  # fmt: skip
    return _finish(simulation, until, arguments)


def _plan(arguments: argparse.Namespace) -> int:
    from libmpm._src.run.plan import build_plan

    source, scaling = _source(arguments), _scaling(arguments)
    until = source.settings.until if arguments.until is None else arguments.until
    if scaling is not None:
        print(f"{dataclasses.replace(scaling, dimension=source.scene.dimension)}\n")
    print(build_plan(source.scene, until=until, **_execution(arguments)))
    return ExitCode.DONE


def _check(arguments: argparse.Namespace) -> int:
    source = _source(arguments)
    source.scene.validate(strict=arguments.strict)
    print(f"{arguments.file}: valid; {source.scene._in_short()}")
    if arguments.advise is not None:
        print(source.scene.advise(error=arguments.advise))
    return ExitCode.DONE


def _resume(arguments: argparse.Namespace) -> int:
    from libmpm._src.output.folder_lock import held_folder

    path, output = arguments.path, arguments.output
    with held_folder(path) if output is None else contextlib.nullcontext():
        return _go_on(path, output, arguments.until, arguments)


def _go_on(
    path: Path, output: Path | None, until: float | None, arguments: argparse.Namespace
) -> int:
    """Continue from a checkpoint, or the newest of a folder."""
    from libmpm._src.output.settings import Output
    from libmpm._src.run.simulation import Simulation

    named = arguments.device
    simulation = Simulation.resume(
        path,
        device=None if named in (None, "auto") else _device(named),
        guard=None if arguments.no_guard else "same",
        partition=_partition(arguments, path) or "same",
    )
    recorded = simulation.recorded_output()
    folder = output or (path if path.is_dir() else None)
    if folder is None and recorded is not None:
        folder = recorded.path
    if folder is None:
        raise SceneError("the checkpoint names no output folder; pass -o")
    settings = recorded.to_dict() if recorded is not None else {}
    settings |= {"path": str(folder), "overwrite": getattr(arguments, "overwrite", False)}
    simulation.set_output(Output(**settings))
    return _finish(simulation, _until(until, simulation.recorded_until()), arguments)


def _export(arguments: argparse.Namespace) -> int:
    from libmpm._src.output.export import export

    made = export(
        arguments.path,
        arguments.to,
        output=arguments.output,
        bodies=arguments.body,
        attributes=arguments.attributes,
        first=float("-inf") if arguments.first is None else arguments.first,
        last=float("inf") if arguments.until is None else arguments.until,
        sensors=not arguments.no_sensors,
        one_file=arguments.one_file,
        device=arguments.device,
    )
    where = f" in {made[0].parent}" if made else "; the run has no frames in that time"
    print(f"{len(made)} file{'s' if len(made) != 1 else ''}{where}")
    return ExitCode.DONE


def _flume(arguments: argparse.Namespace) -> int:
    from libmpm._src.flumes.command import facility_of, keep, report, table
    from libmpm._src.output.folder_lock import held_folder

    folder, case = arguments.output, arguments.case or ""
    if arguments.table:
        print(table(arguments.name, folder))
        return ExitCode.DONE
    facility = facility_of(arguments)
    if folder is None:
        raise SceneError("flume: no folder for the results; pass -o, or --table for the rows alone")
    arguments.without_debris, arguments.file = False, facility.title
    with held_folder(folder):
        # First, so that a run that is cut off says what it is; last, where it was overwritten.
        keep(facility, folder, case, arguments.overwrite)
        code = _run_source(
            facility.run_file(), arguments,
            overwrite=arguments.overwrite, go_on=not arguments.overwrite,
        )  # fmt: skip
        keep(facility, folder, case, True)
    if code == ExitCode.DONE:
        print(report(facility, folder, case))
    return code


def _study(arguments: argparse.Namespace) -> int:
    from libmpm._src.studies.study.command import run_command

    return run_command(arguments)


def _bench(arguments: argparse.Namespace) -> int:
    from libmpm._src.cli.bench import run_command

    return run_command(arguments)


def _info(arguments: argparse.Namespace) -> int:
    from libmpm._src.cli.info import about, collect, describe, text_of

    if arguments.path is None:
        print(json.dumps(collect(), indent=2) if arguments.json else describe())
        return ExitCode.DONE
    found = about(arguments.path)
    print(json.dumps(found, indent=2, ensure_ascii=False) if arguments.json else text_of(found))
    return ExitCode.DONE


def _schema(arguments: argparse.Namespace) -> int:
    from libmpm._src.scene.schema import schema_text

    if arguments.output is None:
        print(schema_text(), end="")
        return ExitCode.DONE
    from libmpm._src.output.atomic_files import replacing

    with replacing(arguments.output) as part:
        part.write_text(schema_text(), encoding="utf-8")
    return ExitCode.DONE


def _import(arguments: argparse.Namespace) -> int:
    from libmpm._src.output.atomic_files import replacing
    from libmpm.compat import claymore

    found = claymore.load(
        arguments.file, cell_size=arguments.cell_size,
        motion_folder=arguments.motion_folder, checkpoint=arguments.checkpoint,
    )  # fmt: skip
    text = json.dumps(found.run_file().to_dict(), indent=2, ensure_ascii=False, allow_nan=False)
    with replacing(arguments.output) as part:
        part.write_text(text + "\n", encoding="utf-8", errors="backslashreplace")
    print(found.report())
    return ExitCode.DONE


_COMMANDS = {
    "demo": _demo,
    "flume": _flume,
    "run": _run,
    "plan": _plan,
    "check": _check,
    "resume": _resume,
    "export": _export,
    "study": _study,
    "bench": _bench,
    "import": _import,
    "info": _info,
    "schema": _schema,
}


def _terminate(number: int, frame: object) -> None:
    """Treat SIGTERM like Ctrl-C, where there is no run to stop at a step."""
    signal.raise_signal(signal.SIGINT)


@contextlib.contextmanager
def _signals(command: str) -> Iterator[None]:
    """Let a batch system's signals end the command in order."""
    from libmpm._src.base.interrupts import stop_signals

    if command in _STEPPING:
        with stop_signals():
            yield
        return
    try:
        previous = signal.signal(signal.SIGTERM, _terminate)
    except ValueError:
        # Only the main thread may set handlers; elsewhere the caller handles signals.
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, previous)


@contextlib.contextmanager
def _plain_warnings() -> Iterator[None]:
    """Show warnings about a model without the place in libmpm that raised them."""
    usual = warnings.formatwarning

    def shown(message: Any, category: Any, *rest: Any, **others: Any) -> str:
        if issubclass(category, ModelWarning):
            return f"libmpm: warning: {message}\n"
        return usual(message, category, *rest, **others)

    warnings.formatwarning = shown
    try:
        yield
    finally:
        warnings.formatwarning = usual


@contextlib.contextmanager
def _all_characters() -> Iterator[None]:
    """Show what standard output has no character for by its number, as standard error does.

    A terminal may be of few characters, and names of files and texts of logs hold any.
    """
    stream = sys.stdout
    before = getattr(stream, "errors", None)
    if before not in ("strict", "surrogateescape") or not hasattr(stream, "reconfigure"):
        yield
        return
    stream.reconfigure(errors="backslashreplace")
    try:
        yield
    finally:
        try:
            stream.reconfigure(errors=before)
        except BrokenPipeError:
            raise  # what was printed is written here, and nobody reads it any more
        except (OSError, ValueError):
            pass  # left for the end of the process, or closed


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return the exit code of the process, an `ExitCode`."""
    began = clock.monotonic()
    parsed = parser().parse_args(arguments)
    parsed.began = began
    try:
        with _all_characters(), _signals(parsed.command), _plain_warnings():
            return _COMMANDS[parsed.command](parsed)
    except Error as error:
        print(f"libmpm: {type(error).__name__}: {error}", file=sys.stderr)
        codes = (c for t, c in EXIT_CODES.items() if isinstance(error, t))
        return next(codes, ExitCode.UNEXPECTED)
    except KeyboardInterrupt:
        print("libmpm: interrupted", file=sys.stderr)
        return ExitCode.INTERRUPTED
    except BrokenPipeError:
        # The reader, such as `head`, has seen enough; the interpreter must not flush to it again.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return ExitCode.DONE


if __name__ == "__main__":
    sys.exit(main())
