"""The options of the commands of `libmpm`."""

from __future__ import annotations

import argparse
import re
from pathlib import Path

from libmpm._src.base.arguments import path_option

__all__ = ["parser", "seconds"]

_LISTED = (
    "Exit codes: 0 done, 2 bad input, 3 numerical failure, 4 output failure, 5 device or memory, "
    "6 stopped by the wall limit or a signal with a checkpoint written (submit again), "
    "130 interrupted."
)


def _places(text: str) -> tuple[float, ...]:
    """Return the numbers between commas."""
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{text!r}; expected places in m, such as 1.5,3.0"
        ) from None


def seconds(text: str) -> float:
    """Return the seconds of "3500", "HH:MM:SS" or "D-HH:MM:SS"."""
    match = re.fullmatch(r"(?:(\d+)-)?(\d+):([0-5]?\d):([0-5]?\d)", text)
    if match:
        days, hours, minutes, seconds = (int(part or 0) for part in match.groups())
        return ((days * 24.0 + hours) * 60 + minutes) * 60 + seconds
    try:
        found = float(text)
    except ValueError:
        found = -1.0
    if not found >= 0:
        raise argparse.ArgumentTypeError(f"{text!r}; expected seconds, HH:MM:SS or D-HH:MM:SS")
    return found


def _add_execution(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("how it is computed")
    group.add_argument(
        "--device", default="auto", help="auto, cpu, cuda, cuda:N, or several: cuda:0,cuda:1"
    )
    group.add_argument("--precision", default="auto", help="auto, single, mixed or double")
    group.add_argument("--pipeline", default="auto", help="auto, fused, two-pass or phased")
    group.add_argument("--threads", type=int, default=0, help="CPU threads; 0 = default")


def _add_writing(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("the run and what it says")
    group.add_argument("--until", type=float, help="end of the run, s; overrides the file")
    group.add_argument(
        "--wall-limit", type=seconds, metavar="TIME",
        help="seconds, HH:MM:SS or D-HH:MM:SS of wall time from the command's start, after which "
        "the run stops with a checkpoint and exit code 6; leave room to write it",
    )  # fmt: skip
    group.add_argument("--no-picture", action="store_true", help="do not draw report.png")
    group.add_argument(
        "--no-guard", action="store_true",
        help="disable run-time checks (energy growth, volume change, particle loss)",
    )  # fmt: skip
    group.add_argument("--quiet", action="store_true", help="no progress bar")
    group = parser.add_argument_group("several devices or ranks")
    group.add_argument(
        "--cuts", choices=("x", "y", "z", "curve"),
        help="several devices: parts by planes across an axis, or along a space-filling curve",
    )  # fmt: skip
    group.add_argument(
        "--at", type=_places, metavar="X,...",
        help="with --cuts x, y or z: places of the first planes, m, one fewer than devices; "
        "--at=-1.2,0.4 where the first is negative",
    )  # fmt: skip
    group.add_argument(
        "--by", choices=("body", "material"),
        help="several devices: each begins with a body, or the bodies of one material",
    )  # fmt: skip
    group.add_argument(
        "--weights", choices=("particles", "measured"),
        help="several CPU ranks: loads by particles, or by the time that they took; default: "
        "particles",
    )  # fmt: skip
    group.add_argument(
        "--rebalance-above", type=float, metavar="RATIO",
        help="several devices: largest load over the mean above which cuts move; 0 = at every "
        "sort, inf = never; default: 1.05",
    )  # fmt: skip


def _add_scaling(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("similitude")
    group.add_argument(
        "--scale", type=float, metavar="RATIO",
        help="Froude similitude: lengths times RATIO, times and velocities times its root, ...",
    )  # fmt: skip
    group.add_argument("--cauchy", action="store_true", help="with --scale: moduli scale too")
    group.add_argument("--reynolds", action="store_true", help="with --scale: viscosities too")


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    made = argparse.ArgumentParser(
        prog="libmpm",
        description="Material point method for floods, debris and the structures they hit.",
        epilog=_LISTED,
    )
    commands = made.add_subparsers(dest="command", required=True)

    importer = commands.add_parser("import", help="a scene of another program as a scene file")
    importer.add_argument("format", choices=("claymore",))
    importer.add_argument("file", type=path_option)
    importer.add_argument(
        "-o", "--output", type=path_option, required=True, help="scene file to write"
    )
    importer.add_argument("--cell-size", type=float, help="m; default: that of the file")
    importer.add_argument(
        "--motion-folder", type=path_option, help="of motion files; default: the file's"
    )
    importer.add_argument(
        "--checkpoint",
        type=path_option,
        help="checkpoint to use instead of the one named in the file",
    )

    demo = commands.add_parser("demo", help="a surge carries debris into a raised box")
    demo.add_argument(
        "-o", "--output", type=path_option, default=Path("libmpm-demo"), help="folder"
    )
    demo.add_argument("--without-debris", action="store_true", help="water only")
    _add_execution(demo)
    _add_writing(demo)

    from libmpm._src.flumes.command import add_arguments as add_flume_arguments

    flume = commands.add_parser(
        "flume", help="a laboratory flume, compared with what was measured there", epilog=_LISTED
    )
    add_flume_arguments(flume)
    _add_execution(flume)
    _add_writing(flume)

    run = commands.add_parser("run", help="run a scene file", epilog=_LISTED)
    run.add_argument("file", type=path_option)
    run.add_argument("-o", "--output", type=path_option, required=True, help="folder")
    existing = run.add_mutually_exclusive_group()
    existing.add_argument("--overwrite", action="store_true", help="replace earlier results")
    existing.add_argument(
        "--continue", dest="go_on", action="store_true",
        help="continue from the folder's newest checkpoint if it has one, else start; nothing is "
        "done to a finished run. A job that is submitted again and again needs no other command",
    )  # fmt: skip
    run.add_argument("--without-debris", action="store_true", help="leave out its debris bodies")
    _add_execution(run)
    _add_writing(run)
    _add_scaling(run)

    plan = commands.add_parser("plan", help="what a scene would store, run and cost")
    plan.add_argument("file", type=path_option)
    plan.add_argument("--until", type=float, help="end, s; overrides the file")
    _add_execution(plan)
    _add_scaling(plan)

    check = commands.add_parser("check", help="validate a scene file: all problems at once")
    check.add_argument("file", type=path_option)
    check.add_argument("--strict", action="store_true", help="warnings count as problems")
    check.add_argument(
        "--advise", type=float, nargs="?", const=0.05, metavar="ERROR",
        help="propose numerical settings within an error, 0.05 where none is given",
    )  # fmt: skip
    _add_scaling(check)

    resume = commands.add_parser("resume", help="continue a run after a stop or kill")
    resume.add_argument("path", type=path_option, help="folder of the run, or a checkpoint file")
    resume.add_argument("-o", "--output", type=path_option, help="another folder for the rest")
    resume.add_argument(
        "--overwrite", action="store_true", help="replace the results of another run in the folder"
    )
    resume.add_argument("--device", help="as of run; default: the checkpoint's own")
    _add_writing(resume)

    from libmpm._src.cli.bench import add_arguments
    from libmpm._src.output.export import FORMATS
    from libmpm._src.studies.study.command import add_arguments as add_study_arguments

    export = commands.add_parser("export", help="frames and sensors in other formats")
    export.add_argument("path", type=path_option, help="folder of a run, or a checkpoint file")
    export.add_argument("--to", required=True, choices=FORMATS)
    export.add_argument("-o", "--output", type=path_option, help="folder; default: RUN/export")
    export.add_argument("--body", nargs="+", help="names of bodies; default: all")
    export.add_argument(
        "--attributes",
        nargs="+",
        help="attributes to export besides position (frames: only stored ones)",
    )
    export.add_argument("--from", dest="first", type=float, help="first time, s")
    export.add_argument("--until", type=float, help="last time, s")
    export.add_argument("--no-sensors", action="store_true", help="frames alone")
    export.add_argument("--one-file", action="store_true", help="npz: everything in run.npz")
    export.add_argument("--device", help="that reads a checkpoint; default: its own")

    add_study_arguments(commands.add_parser("study", help="many scenes from one table"))
    add_arguments(commands.add_parser("bench", help="speed of a collapsing cube of water"))

    info = commands.add_parser(
        "info", help="version, devices, packages; or what a run, scene or checkpoint holds"
    )
    info.add_argument(
        "path", type=path_option, nargs="?", help="folder of a run, scene file, checkpoint"
    )
    info.add_argument("--json", action="store_true", help="as JSON")

    schema = commands.add_parser("schema", help="JSON Schema of scene files, for editors")
    schema.add_argument("-o", "--output", type=path_option, help="file; default: print it")
    return made
