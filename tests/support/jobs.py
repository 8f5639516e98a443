"""Jobs of several processes, started as torchrun would."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import textwrap


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def start(ranks, code, folder, **environment):
    """Start `code` as so many ranks of one job; `folder` is theirs by the name FOLDER."""
    port, made = str(free_port()), []
    for rank in range(ranks):
        variables = os.environ | {
            "RANK": str(rank), "LOCAL_RANK": str(rank), "WORLD_SIZE": str(ranks),
            "MASTER_ADDR": "127.0.0.1", "MASTER_PORT": port, "FOLDER": str(folder),
            "LIBMPM_MEETING_SECONDS": "60", "PYTHONPATH": os.pathsep.join(p for p in sys.path if p),
        } | environment  # fmt: skip
        made.append(
            subprocess.Popen(
                [sys.executable, "-c", code],
                env=variables,
                text=True,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
            )
        )
    return made


def run(ranks, code, folder, **environment):
    """Return (exit code, stdout, stderr) of each rank."""
    out = []
    made = start(ranks, code, folder, **environment)
    for process in made:
        try:
            told = process.communicate(timeout=300)
        except subprocess.TimeoutExpired:
            for one in made:
                one.kill()
            raise
        out.append((process.returncode, *told))
    return out


def well(told):
    """Return what ranks told, all of which have ended well."""
    assert [code for code, _, _ in told] == [0] * len(told), "\n".join(e for _, _, e in told)
    return told


def script(head, code):
    """Return a script of two parts, the second perhaps indented."""
    return head + textwrap.dedent(code)
