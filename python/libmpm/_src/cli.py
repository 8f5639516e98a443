"""The command line: ``libmpm demo | run | plan | check | resume | study | bench | info``."""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from libmpm._src.errors import (
    CapacityError,
    CheckpointError,
    DeviceError,
    Error,
    NumericalError,
    OutputError,
    SceneError,
)

__all__ = ["EXIT_CODES", "main"]

#: Exception -> exit code of the process; 0 is success, 130 an interrupt.
EXIT_CODES: dict[type[Error], int] = {
    SceneError: 2,
    CheckpointError: 2,
    NumericalError: 3,
    OutputError: 4,
    DeviceError: 5,
    CapacityError: 5,
}


def _add_execution(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--device", default="auto", help="auto, cpu, cuda or cuda:N")
    parser.add_argument("--precision", default="auto", help="auto, single, mixed or double")
    parser.add_argument("--pipeline", default="auto", help="auto, fused, two-pass or phased")
    parser.add_argument("--threads", type=int, default=0, help="CPU threads; 0 = default")


def _add_writing(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--until", type=float, help="end of the run, s; overrides the file")
    parser.add_argument("--no-picture", action="store_true", help="do not draw report.png")
    parser.add_argument("--quiet", action="store_true", help="no progress bar")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="libmpm",
        description="Material point method for floods, debris and the structures they hit.",
        epilog="Exit codes: 0 success, 2 bad input, 3 numerical failure, 4 output failure, "
        "5 device or memory, 130 interrupted.",
    )
    commands = parser.add_subparsers(dest="command", required=True)

    demo = commands.add_parser("demo", help="a surge carries debris into a raised box")
    demo.add_argument("-o", "--output", type=Path, default=Path("libmpm-demo"), help="folder")
    demo.add_argument("--without-debris", action="store_true", help="water only")
    _add_execution(demo)
    _add_writing(demo)

    run = commands.add_parser("run", help="run a scene file")
    run.add_argument("file", type=Path)
    run.add_argument("-o", "--output", type=Path, required=True, help="folder")
    run.add_argument("--overwrite", action="store_true", help="replace earlier results")
    run.add_argument("--without-debris", action="store_true", help="leave out its debris bodies")
    _add_execution(run)
    _add_writing(run)

    plan = commands.add_parser("plan", help="what a scene would store, run and cost")
    plan.add_argument("file", type=Path)
    plan.add_argument("--until", type=float, help="end, s; overrides the file")
    _add_execution(plan)

    check = commands.add_parser("check", help="validate a scene file")
    check.add_argument("file", type=Path)
    check.add_argument("--strict", action="store_true", help="warnings count as problems")

    resume = commands.add_parser("resume", help="continue a run after a stop or kill")
    resume.add_argument("path", type=Path, help="folder of the run, or a checkpoint file")
    resume.add_argument("-o", "--output", type=Path, help="another folder for the rest")
    resume.add_argument("--device", help="default: the checkpoint's own")
    _add_writing(resume)

    from libmpm._src.bench import add_arguments
    from libmpm._src.study.command import add_arguments as add_study_arguments

    add_study_arguments(commands.add_parser("study", help="many scenes from one table"))
    add_arguments(commands.add_parser("bench", help="speed of a collapsing cube of water"))
    commands.add_parser("info", help="version, backends, devices, threads")
    return parser


def _execution(arguments: argparse.Namespace) -> dict[str, Any]:
    names = ("device", "precision", "pipeline", "threads")
    return {name: getattr(arguments, name) for name in names}


def _until(stated: float | None, recorded: float | None) -> float:
    until = recorded if stated is None else stated
    if until is None:
        raise SceneError('the end is not stated: pass --until, or give "until" in the "run" key')
    return until


def _finish(simulation: Any, until: float, arguments: argparse.Namespace) -> int:
    from libmpm._src.demo import run_to_end

    text = run_to_end(
        simulation, until, progress=not arguments.quiet, picture=not arguments.no_picture
    )
    print(text)
    return 0


def _demo(arguments: argparse.Namespace) -> int:
    from libmpm._src.demo import load_demo

    # The folder is the demonstration's own unless the user names one that holds other results.
    return _run_source(load_demo(), arguments, overwrite=arguments.output == Path("libmpm-demo"))


def _run(arguments: argparse.Namespace) -> int:
    from libmpm._src.runfile import read_run_file

    return _run_source(read_run_file(arguments.file), arguments, overwrite=arguments.overwrite)


def _run_source(source: Any, arguments: argparse.Namespace, *, overwrite: bool) -> int:
    from libmpm._src.demo import start
    from libmpm._src.runfile import without_debris

    if arguments.without_debris:
        source = without_debris(source)
    until = _until(arguments.until, source.settings.until)
    simulation = start(source, arguments.output, overwrite=overwrite, **_execution(arguments))
    return _finish(simulation, until, arguments)


def _plan(arguments: argparse.Namespace) -> int:
    from libmpm._src.plan import build_plan
    from libmpm._src.runfile import read_run_file

    source = read_run_file(arguments.file)
    until = source.settings.until if arguments.until is None else arguments.until
    print(build_plan(source.scene, until=until, **_execution(arguments)))
    return 0


def _check(arguments: argparse.Namespace) -> int:
    from libmpm._src.runfile import read_run_file

    source = read_run_file(arguments.file)
    source.scene.validate(strict=arguments.strict)
    print(f"{arguments.file}: valid; {source.scene!r}")
    return 0


def _resume(arguments: argparse.Namespace) -> int:
    from libmpm._src.output.writer import Output
    from libmpm._src.simulation import Simulation

    path = arguments.path
    simulation = Simulation.resume(path, device=arguments.device)
    recorded = simulation.recorded_output()
    folder = arguments.output or (path if path.is_dir() else None)
    if folder is None and recorded is not None:
        folder = recorded.path
    if folder is None:
        raise SceneError("the checkpoint names no output folder; pass -o")
    settings = recorded.to_dict() if recorded is not None else {}
    simulation.set_output(Output(**(settings | {"path": str(folder)})))
    return _finish(simulation, _until(arguments.until, simulation.recorded_until()), arguments)


def _study(arguments: argparse.Namespace) -> int:
    from libmpm._src.study.command import run_command

    return run_command(arguments)


def _bench(arguments: argparse.Namespace) -> int:
    from libmpm._src.bench import run_command

    return run_command(arguments)


def _info(arguments: argparse.Namespace) -> int:
    from libmpm._src.info import describe

    print(describe())
    return 0


_COMMANDS = {
    "demo": _demo,
    "run": _run,
    "plan": _plan,
    "check": _check,
    "resume": _resume,
    "study": _study,
    "bench": _bench,
    "info": _info,
}


def _terminate(number: int, frame: object) -> None:
    """Treat a batch system's SIGTERM like Ctrl-C: stop at a step and write a checkpoint."""
    signal.raise_signal(signal.SIGINT)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return the exit code of the process."""
    parsed = _parser().parse_args(arguments)
    try:
        previous = signal.signal(signal.SIGTERM, _terminate)
    except ValueError:
        # Only the main thread may set handlers; elsewhere the caller looks after signals.
        previous = None
    try:
        return _COMMANDS[parsed.command](parsed)
    except Error as error:
        print(f"libmpm: {type(error).__name__}: {error}", file=sys.stderr)
        return next((c for t, c in EXIT_CODES.items() if isinstance(error, t)), 1)
    except KeyboardInterrupt:
        print("libmpm: interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:
        # The reader, such as `head`, has seen enough; the interpreter must not flush to it again.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    finally:
        if previous is not None:
            signal.signal(signal.SIGTERM, previous)


if __name__ == "__main__":
    sys.exit(main())
