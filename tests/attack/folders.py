"""Full disks, folders that may not be written, and folders that something has damaged."""

from __future__ import annotations

import contextlib
import os
import random
import resource
import shutil
import signal
from collections.abc import Mapping
from pathlib import Path

import libmpm
from attack.base import Attack, Defect
from attack.inputs import command
from attack.kills import compare, go_on
from libmpm._src.cli.commands import ExitCode
from support import fuzzing

__all__ = ["Folders"]

_SCENE = "puddle"
_UNTIL = 0.04
#: Whoever owns nothing.
_NOBODY = 65534


class Folders(Attack):
    """Disks that are full, folders that are read-only or damaged."""

    name = "folders"
    what = "full disks, folders without permission, folders with damaged files"
    unit = "folders"
    share = 1.0
    limit = 300.0

    def prepare(self) -> None:
        """Run a scene to its end, and to its middle."""
        go_on(_SCENE, self.folder / "whole", _UNTIL)
        shutil.copytree(self.folder / "whole", self.folder / "half")
        for name in ("end.npz", "plan.txt"):
            (self.folder / "half" / name).unlink(missing_ok=True)

    def case(self, seed: str, number: int, room: Path) -> Mapping[str, int]:
        """Disturb a run, or the folder of one; then let it go on undisturbed."""
        rng = self.rng(seed, number)
        way = rng.choice((self._full, self._closed, self._damaged, self._damaged))
        return {way(rng, room): 1}

    def _run(self, folder: Path) -> BaseException | None:
        found = fuzzing.answer(lambda: go_on(_SCENE, folder, _UNTIL))
        return found if isinstance(found, libmpm.Error) else None

    def _full(self, rng: random.Random, room: Path) -> str:
        """No file may grow beyond a limit: what a full disk or quota looks like to a program."""
        folder = room / "run"
        limit = int(10 ** rng.uniform(0, 6))
        self.note(room, limit=limit)
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        before = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, before[1]))
        try:
            error = self._run(folder)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
        if error is not None and not isinstance(error, libmpm.OutputError):
            raise Defect(f"a full disk is told as {type(error).__name__}: {error}")
        if error is None:
            compare(folder, self.folder / "whole")
            return "full disk: there was room"
        return f"full disk: refused, {self._afterwards(folder)}"

    def _closed(self, rng: random.Random, room: Path) -> str:
        """A folder of somebody else."""
        folder = room / "run"
        folder.mkdir()
        for path in (*room.parents[:6], room, folder):
            with contextlib.suppress(OSError):
                os.chmod(path, os.stat(path).st_mode | 0o555)
        os.chmod(folder, 0o555)
        root = os.geteuid() == 0
        if root:
            os.seteuid(_NOBODY)
        try:
            error = self._run(folder)
        finally:
            if root:
                os.seteuid(0)
        if not isinstance(error, libmpm.OutputError):
            raise Defect(f"a folder without permission: {error!r}")
        os.chmod(folder, 0o755)
        return f"no permission: refused, {self._afterwards(folder)}"

    def _damaged(self, rng: random.Random, room: Path) -> str:
        """Files that are cut, emptied, changed, gone, or folders."""
        folder = room / "run"
        shutil.copytree(self.folder / "half", folder)
        said = []
        for _ in range(rng.choice((1, 1, 2, 4))):
            path = rng.choice(sorted(p for p in folder.rglob("*") if p.exists()))
            how = rng.choice(("cut", "empty", "gone", "bytes", "folder", "file"))
            said.append(f"{path.relative_to(folder)}: {how}")
            _spoil(path, how, rng)
        self.note(room, said=said)
        codes = [command("info", folder)]
        codes.append(command("export", folder, "--to", "csv", "-o", room / "exported"))
        error = self._run(folder)
        end = "refused" if error is not None else "went on"
        read = sum(code == ExitCode.DONE for code in codes)
        return f"damaged: {read} of 2 read, {end}"

    def _afterwards(self, folder: Path) -> str:
        """Return what becomes of the run where nothing disturbs it any more."""
        error = self._run(folder)
        if error is not None:
            raise Defect(f"it does not go on afterwards: {type(error).__name__}: {error}")
        compare(folder, self.folder / "whole")
        return "went on to the same bits"


def _spoil(path: Path, how: str, rng: random.Random) -> None:
    if how == "gone" or how == "folder" or (how == "file" and path.is_dir()):
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink()
        if how == "folder":
            path.mkdir()
        elif how == "file":
            path.write_text("a file\n")
        return
    if path.is_dir():
        return
    raw = path.read_bytes()
    if how == "cut":
        path.write_bytes(raw[: rng.randrange(len(raw) + 1)])
    elif how == "empty":
        path.write_bytes(b"")
    elif raw:
        path.write_bytes(fuzzing.broken_bytes(raw, rng)[0])
