"""The command ``libmpm study run | status | collect``."""

from __future__ import annotations

import argparse
import importlib.util
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from libmpm._src.base.arguments import path_option
from libmpm._src.base.values import nearest, shown
from libmpm._src.errors import SceneError

if TYPE_CHECKING:
    from libmpm._src.studies.study.study import Study
    from libmpm._src.studies.study.table import StudyResult

__all__ = ["add_arguments", "run_command"]

#: Exit code of a study of which cases failed.
_SOME_FAILED = 3
#: Name of the function that a study's file defines.
_HOOK = "study"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the sub-commands."""
    parser.epilog = (
        "Exit codes: 0 success, 2 bad input, 3 some cases or responses failed, 4 output failure, "
        "5 device or memory, 130 interrupted."
    )
    actions = parser.add_subparsers(dest="action", required=True)

    run = actions.add_parser("run", help="run what has not finished yet")
    run.add_argument(
        "file", type=path_option, help="a Python file with study(folder) -> libmpm.Study"
    )
    run.add_argument("-o", "--output", type=path_option, required=True, help="folder of the study")
    run.add_argument("--workers", type=int, help="processes; default: one a GPU, or by cores")
    run.add_argument("--threads", type=int, default=1, help="CPU threads of a case; default 1")
    run.add_argument(
        "--device", default="auto", help="auto, cpu, cuda:N, or several: cuda:0,cuda:1"
    )
    run.add_argument("--retry-failed", action="store_true", help="run failed cases again")
    run.add_argument(
        "--time-limit", type=float, metavar="S", help="wall time of a case, s; default: any"
    )
    run.add_argument("--quiet", action="store_true", help="no progress bar")

    status = actions.add_parser("status", help="how the cases of a folder stand")
    status.add_argument("folder", type=path_option)

    collect = actions.add_parser("collect", help="the table of what has finished")
    collect.add_argument("folder", type=path_option)
    collect.add_argument("-o", "--output", type=path_option, help="write it to a .csv or .h5 file")


def run_command(arguments: argparse.Namespace) -> int:
    """Run a sub-command and return the exit code."""
    from libmpm._src.studies.study.study import Study

    if arguments.action == "run":
        return _run(arguments)
    study = Study.open(arguments.folder)
    if arguments.action == "status":
        status = study.status()
        print(status)
        return _SOME_FAILED if status.counts["failed"] else 0
    result = study.collect()
    if arguments.output is not None:
        _save(result, arguments.output)
    print(result)
    return _SOME_FAILED if result.failed else 0


def _run(arguments: argparse.Namespace) -> int:
    study = load_study(arguments.file, arguments.output)
    device: Any = arguments.device.split(",") if "," in arguments.device else arguments.device
    result = study.run(
        workers=arguments.workers,
        threads=arguments.threads,
        device=device,
        progress=not arguments.quiet,
        retry_failed=arguments.retry_failed,
        time_limit=arguments.time_limit,
    )
    print(result)
    print(f"table    {study.folder / 'table.csv'}, {study.folder / 'table.h5'}")
    return _SOME_FAILED if result.failed else 0


def _save(result: StudyResult, path: Path) -> None:
    writers = {".csv": result.save_csv, ".h5": result.save_hdf5, ".hdf5": result.save_hdf5}
    if path.suffix not in writers:
        raise SceneError(f"{path}: {nearest(path.suffix, writers)} as the end of the table's name")
    writers[path.suffix](path)


def load_study(path: Path, folder: Path) -> Study:
    """Return what ``study(folder)`` of a Python file returns; raises `SceneError`."""
    from libmpm._src.studies.study.study import Study

    if not path.is_file():
        raise SceneError(f"{path}: no such file; give a Python file that defines study(folder)")
    specification = importlib.util.spec_from_file_location("libmpm_study", path.resolve())
    if specification is None or specification.loader is None:
        raise SceneError(f"{path}: not a Python file; expected a name that ends in .py")
    module = importlib.util.module_from_spec(specification)
    # The file may import its neighbours, and what it defines may be pickled.
    sys.modules["libmpm_study"] = module
    sys.path.insert(0, str(path.resolve().parent))
    try:
        specification.loader.exec_module(module)
    except (SyntaxError, UnicodeDecodeError, RecursionError, MemoryError) as error:
        line = getattr(error, "lineno", None)
        raise SceneError(
            f"{path}{f', line {line}' if line else ''}: no Python that can be read: {error}; "
            "expected a file that defines study(folder); correct it"
        ) from error
    hook = getattr(module, _HOOK, None)
    if not callable(hook):
        raise SceneError(
            f"{path}: defines no function '{_HOOK}'; expected study(folder), which returns "
            "libmpm.Study(folder, factory, rows, until=...)"
        )
    made = hook(folder)
    if not isinstance(made, Study):
        raise SceneError(
            f"{path}: study(folder) returned {shown(made, 60)}; expected a libmpm.Study"
        )
    return made
