"""Files as disks, kills and hands damage them: every reader is fed every kind of damage."""

from __future__ import annotations

import json
import os
import random
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

#: Values that stand where others are expected.
_STRANGE = (None, True, -1, 1e300, 10**25, "text", [], {}, [[1, 2], None], {"a": {}})


def _flipped(raw: bytes, rng: random.Random) -> bytes:
    """Some bits wrong, most of them near the start, where a file says what it is."""
    changed = bytearray(raw)
    for _ in range(rng.choice((1, 3, 20))):
        most = len(raw) if rng.random() < 0.5 else min(len(raw), 4096)
        if most:
            changed[rng.randrange(most)] ^= 1 << rng.randrange(8)
    return bytes(changed)


def _other_type(raw: bytes, rng: random.Random) -> bytes:
    """JSON with one value of another type; of other files, the text of a JSON file."""
    try:
        document = json.loads(raw)
    except (ValueError, RecursionError):
        return b'{"time": "text"}'
    strange = rng.choice(_STRANGE)
    way, owner, key = 0, None, None
    item: Any = document
    while isinstance(item, dict | list) and item and (owner is None or rng.random() < 0.7):
        key = rng.choice(list(item) if isinstance(item, dict) else range(len(item)))
        owner, item, way = item, item[key], way + 1
    if owner is None:
        return json.dumps(strange).encode()
    if rng.random() < 0.2:
        del owner[key]
    else:
        owner[key] = strange
    return json.dumps(document).encode()


#: Name -> what becomes of a file's bytes.
CONTENTS: dict[str, Callable[[bytes, random.Random], bytes]] = {
    "empty": lambda raw, rng: b"",
    "half": lambda raw, rng: raw[: len(raw) // 2],
    "without its end": lambda raw, rng: raw[:-7],
    "zeros": lambda raw, rng: bytes(len(raw)),
    "noise": lambda raw, rng: rng.randbytes(len(raw)),
    "bits": _flipped,
    "another type": _other_type,
    "text": lambda raw, rng: b"time step\n1,2\n",
    "null": lambda raw, rng: b"null",
    "list": lambda raw, rng: b"[1, [2]]",
    "deep": lambda raw, rng: b"[" * 200_000,
    "twice": lambda raw, rng: raw + raw,
}

#: Name -> what becomes of the file itself.
PLACES: dict[str, Callable[[Path], None]] = {
    "gone": lambda path: path.unlink(),
    "a folder": lambda path: (path.unlink(), path.mkdir(), (path / "x").write_text("x")),  # type: ignore[dict-item]
    "a link to nothing": lambda path: (path.unlink(), path.symlink_to("nowhere")),  # type: ignore[dict-item]
    "a link to itself": lambda path: (path.unlink(), path.symlink_to(path.name)),  # type: ignore[dict-item]
    "unreadable": lambda path: path.chmod(0),
}
if os.geteuid() == 0:
    del PLACES["unreadable"]  # root may read anything

KINDS = (*CONTENTS, *PLACES)


def damage(path: Path, kind: str, rng: random.Random) -> None:
    """Damage a file, or a folder, in one of `KINDS`."""
    if path.is_dir():
        shutil.rmtree(path)
        path.write_bytes(b"a folder was here")
        if kind not in CONTENTS:
            PLACES[kind](path)
    elif kind in CONTENTS:
        path.write_bytes(CONTENTS[kind](path.read_bytes(), rng))
    else:
        PLACES[kind](path)


def cases(files: list[str], calls: list[str], count: int | None) -> Iterator[tuple[str, str, str]]:
    """Yield (file, kind of damage, call): `count` of them drawn at random, or all."""
    every = [(file, kind, call) for file in files for kind in KINDS for call in calls]
    if count is None:
        yield from every
        return
    rng = random.Random(7)
    # Each file with each call, and each kind of damage, at least once.
    pairs = [(file, call) for file in files for call in calls]
    rng.shuffle(pairs)
    kinds = [KINDS[i % len(KINDS)] for i in range(len(pairs))]
    drawn = [(file, kind, call) for (file, call), kind in zip(pairs, kinds, strict=True)]
    yield from drawn[:count]
