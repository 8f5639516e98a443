"""Breaks valid documents and files in ways that users, editors and disks do, and judges the answer.

Everything follows from a seed and the number of a case, so that a case can be made again alone.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import math
import numbers
import random
import signal
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from datetime import datetime
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

import libmpm
from support.patience import queued

#: Seconds of processor time after which a case counts as hanging, and how many times as long it may
#: take on a machine that others use too.
PATIENCE, BUSY = 20.0, 6.0
#: Bytes of memory that a case may take beyond what the process has.
ROOM = 3 << 30

WORDS = ("", " ", "text", "NaN", "inf", "1", "x-", "all", "..", "a/b", "\0", "\ud800", "💧", "ə̃",
         "water\n", "a" * 5000, "TaitFluid", "__class__", "{}", "%s%n")  # fmt: skip
NUMBERS = (0, 1, -1, 2, 0.5, -0.0, 7.3, 1e-12, -1e12, 1e9, 2**31, 2**32, 2**53 + 1, 2**63, 2**64,
           -(2**63), 1e18, 1e30, 1e-30, 1e300, -1e308, 5e-324, 1e-300)  # fmt: skip
NOT_FINITE = (math.nan, math.inf, -math.inf)
HUGE = (10**400, -(10**400))
SHAPES = ([], {}, [[]], [None], [1, 2], [1, 2, 3, 4], [[1, 2], [3]], {"type": "Box"},
          {"type": "Nothing"}, {"type": []}, {"type": {}}, {"type": None}, {"type": 3},
          {"type": "Slip"}, {"type": "Body"}, {"type": "Box", "lower": [0, 0], "upper": [1, 1]},
          {"a": 1}, {"": 1}, {"type": "Method", "cfl": 0.1})  # fmt: skip


def brief(item: Any, length: int = 60) -> str:
    """The start of an object's text; there are numbers and nests that have none."""
    try:
        return f"{item!r:.{length}}"
    except (ValueError, RecursionError):
        return f"<{type(item).__name__}>"


def _sort(item: Any) -> str:
    """What an object is taken for."""
    sorts = {
        "number": numbers.Real,
        "text": str,
        "list": (list, tuple, np.ndarray, range),
        "object": Mapping,
    }
    return next((name for name, kinds in sorts.items() if isinstance(item, kinds)), "other")


def nested(depth: int) -> Any:
    """A list in a list in a list ..."""
    item: Any = 0.5
    for _ in range(depth):
        item = [item]
    return item


def python_values() -> list[Any]:
    """What only a program can put into a scene, not a file."""
    return [
        np.float64("nan"), np.float32(0.25), np.int64(3), np.bool_(True), np.str_("water"),
        np.array(1.0), np.array([]), np.zeros((2, 2)), np.array([1.0, None]), np.array(["a", "b"]),
        np.array([math.nan, 1.0]), np.float64(0.5), np.datetime64("2020-01-01"), np.ma.masked,
        b"bytes", bytearray(b"x"), {1, 2}, frozenset(), object(), 1j, Decimal("0.5"),
        Decimal("NaN"), 10**5000, Fraction(1, 3), datetime(2020, 1, 1), Path("a"), range(3),
        iter([1, 2]), (1, 2), (), len, int, ..., NotImplemented, memoryview(b"ab"), {1: 2},
        {None: 1}, {("a",): 1}, slice(1), libmpm.shapes.Box(lower=(0, 0), upper=(1, 1)),
    ]  # fmt: skip


@dataclasses.dataclass
class Broken:
    """A document that was changed.

    document     what to read
    said         what was done to it, in words
    named        of these a refusal must name one; nothing where any problem may follow
    refuse       whether it may not be accepted
    deep         whether it is nested too deep for Python's own functions
    path         the file that holds it instead
    """

    document: Any
    said: list[str]
    named: set[str] = dataclasses.field(default_factory=set)
    refuse: bool = False
    deep: bool = False
    path: Path = Path()


def places(item: Any) -> Iterator[tuple[Any, ...]]:
    """Every place of a document but its root, as the keys that lead there, however deep."""

    def inner(value: Any) -> Iterator[tuple[Any, Any]]:
        return iter(value.items() if isinstance(value, dict) else enumerate(value))

    open_ = [((), inner(item))]
    while open_:
        way, rest = open_[-1]
        for key, value in rest:
            yield (*way, key)
            if isinstance(value, dict | list):
                open_.append(((*way, key), inner(value)))
                break
        else:
            open_.pop()


def _not_finite(document: Any) -> bool:
    """Tell whether a document has a number that is refused wherever it stands."""
    found = ((way[-1], at(document, way)) for way in places(document))
    return any(
        isinstance(item, float) and not math.isfinite(item) and not (key == 1 and item == math.inf)
        for key, item in found
    )


def copied(item: Any) -> Any:
    """Return a copy of lists and dicts, however deep; what else is in them needs none."""
    if not isinstance(item, dict | list):
        return item
    copy = item.copy()
    left = [copy]
    while left:
        found = left.pop()
        for key, value in list(found.items() if isinstance(found, dict) else enumerate(found)):
            if isinstance(value, dict | list):
                found[key] = value.copy()
                left.append(found[key])
    return copy


def at(document: Any, way: tuple[Any, ...]) -> Any:
    """What is at a place."""
    for key in way:
        document = document[key]
    return document


def _descend(document: Any, rng: random.Random) -> tuple[Any, ...]:
    """A place reached by a random child each time; long lists weigh no more than short ones."""
    way: tuple[Any, ...] = ()
    while True:
        item = at(document, way)
        if not isinstance(item, dict | list) or not item or (way and rng.random() < 0.25):
            return way
        way = (*way, rng.choice(list(item) if isinstance(item, dict) else range(len(item))))


class Breaker:
    """Changes documents; `plain` ones stay within what JSON can hold."""

    def __init__(self, documents: dict[str, Any], seed: Any, case: int, plain: bool) -> None:
        """Take valid documents; the seed and the number of the case decide all else."""
        self.rng = random.Random(f"{seed}:{case}")
        self.documents = documents
        self.plain = plain

    def broken(self) -> Broken:
        """Return one document, changed once, or a few times."""
        name = self.rng.choice(sorted(self.documents))
        result = Broken(copied(self.documents[name]), [f"document '{name}'"])
        for _ in range(self.rng.choice((1, 1, 1, 1, 2, 3))):
            self._change(result)
            if result.deep:
                break  # what is nested so deep can be neither copied nor walked
        if result.refuse and len(result.said) > 2:
            result.refuse = _not_finite(result.document)  # a later change may take it out again
        if len(result.said) > 2:
            result.named = set()  # one change may hide another
        return result

    def _change(self, broken: Broken) -> None:
        rng, document = self.rng, broken.document
        # An earlier change may have left nothing to choose from.
        anywhere = list(places(document)) if rng.random() < 0.4 else []
        way = rng.choice(anywhere) if anywhere else _descend(document, rng)
        if not way:
            return
        owner, key, old = at(document, way[:-1]), way[-1], at(document, way)
        change = rng.choice(
            [self._other_value] * 5
            + [self._number] * 3
            + [self._remove, self._unknown, self._items, self._text, self._graft, self._wrap]
        )
        said = change(owner, key, old, broken)
        if said:
            broken.said.append(f"{'.'.join(map(str, way))}: {said}")
            words = [str(k) for k in way if isinstance(k, str)]
            if broken.named:
                broken.named |= {words[-1]} if words else set()

    # What is done -----------------------------------------------------------------------------

    def _other_value(self, owner: Any, key: Any, old: Any, broken: Broken) -> str:
        rng = self.rng
        pools: list[Any] = [WORDS, NUMBERS, NOT_FINITE, HUGE, SHAPES, (None, True, False)]
        if not self.plain:
            pools += [python_values()] * 2
        pool = rng.choice(pools)
        new = rng.choice(pool)
        if rng.random() < 0.02:
            pool, new, broken.deep = (), nested(rng.choice((3, 900, 5000))), True
        owner[key] = copied(new) if pool is SHAPES else new
        if pool is NOT_FINITE and key not in ("run", "$schema"):
            # The end of a boundary's time may be infinite.
            broken.refuse = not (key == 1 and new == math.inf)
        # Nothing is what an absent key means, and of a deep nest no part is read.
        if new is None or broken.deep:
            pass
        elif pool in (NOT_FINITE, HUGE) or _sort(old) != _sort(new):
            tag = {str(new.get("type"))} if isinstance(new, dict) else set()
            broken.named = tag | {str(key), brief(new, 20)}
        return f"{brief(old)} became {brief(new)}"

    def _number(self, owner: Any, key: Any, old: Any, broken: Broken) -> str:
        """Another number: another unit, another sign, out of every range."""
        if isinstance(old, bool) or not isinstance(old, int | float) or abs(old) > 1e300:
            return ""
        # A cell size a thousand times smaller is no mistake, it takes hours.
        fine = () if key in ("cell_size", "spacing") else (1e-3, 1e-6)
        factor = self.rng.choice((*fine, 1000, -1, 1e6, 0, 1e20, 1e-20, 0.1, 10, 1e300))
        owner[key] = old * factor
        return f"{old!r} times {factor:g}"

    def _remove(self, owner: Any, key: Any, old: Any, broken: Broken) -> str:
        del owner[key]
        return f"{brief(old)} removed"

    def _unknown(self, owner: Any, key: Any, old: Any, broken: Broken) -> str:
        """A key that nobody knows, or one misspelt."""
        if not isinstance(owner, dict) or not isinstance(key, str):
            return ""
        rng = self.rng
        new = rng.choice((key + "s", key[:-1], key.upper(), "comment", "", "💧", "\ud800", "self"))
        if not self.plain and rng.random() < 0.3:
            new = rng.choice((1, None, ("a",), 0.5, b"key"))
        if new in owner:
            return ""
        owner[new] = owner.pop(key) if rng.random() < 0.5 else copied(old)
        return f"has the key {new!r}"

    def _items(self, owner: Any, key: Any, old: Any, broken: Broken) -> str:
        """A list with one item twice, one less, none, or in another order."""
        if not isinstance(old, list) or not old:
            return ""
        rng = self.rng
        new = list(old)
        how = rng.choice(("twice", "less", "none", "turned", "many", "swapped"))
        i, j = rng.randrange(len(new)), rng.randrange(len(new))
        if how == "twice":
            new.insert(i, copied(new[i]))
        elif how == "less":
            del new[i]
        elif how == "none":
            new = []
        elif how == "turned":
            new.reverse()
        elif how == "many":
            new = new * 50
        else:
            new[i], new[j] = new[j], new[i]
        owner[key] = copied(new)
        return f"items: {how}"

    def _text(self, owner: Any, key: Any, old: Any, broken: Broken) -> str:
        if not isinstance(old, str):
            return ""
        rng = self.rng
        i = rng.randrange(len(old) + 1)
        new = rng.choice((
            old[:i] + rng.choice(("x", " ", "\n", "\0", "é", "/", "(", "'", "\u202e")) + old[i:],
            old[:i], old.upper(), old[::-1], old + old, f"({old})", f"{old} ** 9 ** 9", "(" * 500,
            "+".join(["x"] * 3000), "-" * 2000 + "x",
        ))  # fmt: skip
        owner[key] = new
        return f"{brief(old)} became {brief(new)}"

    def _graft(self, owner: Any, key: Any, old: Any, broken: Broken) -> str:
        """What stands elsewhere, in this file or another."""
        other = self.documents[self.rng.choice(sorted(self.documents))]
        way = self.rng.choice(list(places(other)) or [()])
        owner[key] = copied(at(other, way))
        return f"{brief(old)} became what is at {'.'.join(map(str, way))}"

    def _wrap(self, owner: Any, key: Any, old: Any, broken: Broken) -> str:
        if isinstance(old, list) and old and self.rng.random() < 0.5:
            owner[key] = old[0]
            return "became its first item"
        owner[key] = [old]
        return "became a list of itself"


def broken_text(text: str, rng: random.Random) -> tuple[bytes, str]:
    """Return a text file with damage, as bytes, and what was done."""
    raw = bytearray(text.encode())
    i = rng.randrange(len(raw) + 1)
    how = rng.choice(("cut", "byte", "bytes", "utf-16", "bom", "deep", "empty", "twice", "key",
                      "nul", "line", "digits"))  # fmt: skip
    if how == "cut":
        raw = raw[:i]
    elif how in ("byte", "bytes"):
        for _ in range(1 if how == "byte" else 20):
            if raw:
                raw[rng.randrange(len(raw))] = rng.randrange(256)
    elif how == "utf-16":
        raw = bytearray(text.encode("utf-16"))
    elif how == "bom":
        raw = bytearray(b"\xef\xbb\xbf") + raw
    elif how == "deep":
        raw = bytearray(b"[" * rng.choice((10, 100_000)))
    elif how == "empty":
        raw = bytearray()
    elif how == "twice":
        raw = raw + raw
    elif how == "key":
        raw = bytearray(text.replace("{", '{"name": "other", "name": "one", ', 1).encode())
    elif how == "nul":
        raw[i:i] = b"\0" * rng.choice((1, 4096))
    elif how == "line":
        lines = text.splitlines(keepends=True)
        k = rng.randrange(len(lines)) if lines else 0
        lines[k : k + 1] = rng.choice(([], lines[k : k + 1] * 2, ["nan inf -1\n"]))
        raw = bytearray("".join(lines).encode())
    else:
        found = [k for k, c in enumerate(raw) if chr(c).isdigit()]
        if found:
            k = rng.choice(found)
            raw[k : k + 1] = rng.choice((b"1e999", b"-", b"NaN", b"9" * 400, b"1e-999", b"0x1"))
    return bytes(raw), f"{how} at {i} of {len(raw)} bytes"


def broken_bytes(raw: bytes, rng: random.Random) -> tuple[bytes, str]:
    """Return a binary file with damage, and what was done."""
    changed = bytearray(raw)
    how = rng.choice(("cut", "flip", "flips", "zeros", "swap", "tail", "empty"))
    i, j = sorted(rng.randrange(len(raw)) for _ in range(2))
    if how == "cut":
        changed = changed[:i]
    elif how in ("flip", "flips"):
        for _ in range(1 if how == "flip" else 40):
            changed[rng.randrange(len(raw))] ^= 1 << rng.randrange(8)
    elif how == "zeros":
        changed[i:j] = bytes(j - i)
    elif how == "swap":
        changed[i:j] = changed[i:j][::-1]
    elif how == "tail":
        changed += b"tail" * 100
    else:
        changed = bytearray()
    return bytes(changed), f"{how} at {i} to {j} of {len(raw)} bytes"


# Judging --------------------------------------------------------------------------------------


class Hang(BaseException):
    """A case that took too long."""


@contextlib.contextmanager
def bounded(seconds: float = PATIENCE, room: int = ROOM) -> Iterator[None]:
    """Interrupt what takes longer than so many seconds, and refuse it more than so much memory.

    Seconds are of processor time; for what waits, of wall time in which it was not waiting for a
    processor.
    """
    began, waited = time.monotonic(), queued()
    over = False

    def ring(number: int, frame: object) -> None:
        # Python hears of a signal a little later, perhaps on the way out: an alarm that is set anew
        # there would end the process once its handler is gone.
        if over:
            return
        had = time.monotonic() - began - (queued() - waited)
        if number == signal.SIGALRM and had < BUSY * seconds:
            signal.setitimer(signal.ITIMER_REAL, max(BUSY * seconds - had, 0.1))
            return
        raise Hang(f"no answer after {seconds:g} s")

    timers = {signal.SIGPROF: signal.ITIMER_PROF, signal.SIGALRM: signal.ITIMER_REAL}
    before = {number: signal.signal(number, ring) for number in timers}
    signal.setitimer(signal.ITIMER_PROF, seconds)
    signal.setitimer(signal.ITIMER_REAL, BUSY * seconds)
    try:
        with _little_memory(room), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        over = True
        for number, timer in timers.items():
            signal.setitimer(timer, 0)
            signal.signal(number, before[number])


@contextlib.contextmanager
def _little_memory(room: int) -> Iterator[None]:
    try:
        import resource

        pages = int(Path("/proc/self/statm").read_text().split()[0])
    except (ImportError, OSError):
        yield
        return
    before = resource.getrlimit(resource.RLIMIT_AS)
    limit = pages * resource.getpagesize() + room
    if before[1] != resource.RLIM_INFINITY:
        limit = min(limit, before[1])
    resource.setrlimit(resource.RLIMIT_AS, (limit, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


def answer(call: Callable[[], Any], also: tuple[type[Exception], ...] = ()) -> Any:
    """Return what a call gives, or the error that it is allowed to raise; all else is a defect."""
    with bounded():
        try:
            return call()
        except libmpm.Error as error:
            assert str(error).strip(), f"{type(error).__name__} says nothing"
            return error
        except also as error:
            return error


def stored(raw: bytes, path: Path, said: list[str]) -> Broken:
    """Write a broken file; its start is what a failure prints."""
    path.write_bytes(raw)
    return Broken(raw[:4000].decode(errors="backslashreplace"), said, path=path)


def spoil(arrays: dict[str, Any], rng: random.Random) -> str:
    """Change one of a checkpoint's arrays as no disk does, and say how.

    Its numbers stay: a checksum guards them, so the engine may trust them.
    """
    name = rng.choice(sorted(k for k in arrays if k != "header"))
    old = arrays[name]
    how = rng.choice(("gone", "short", "flat", "objects"))
    if how == "gone":
        del arrays[name]
        return f"{name}: gone"
    if how == "objects":
        arrays[name] = np.array([{}], dtype=object)
        return f"{name}: objects"
    arrays[name] = old.ravel()[: old.size // 2] if how == "short" else old.reshape(1, -1)
    return f"{name}: {how}"


def smaller(broken: Broken, judge: Callable[[Broken], Any], error: type[BaseException]) -> Broken:
    """Return the case without whatever can be left out of its document, the defect staying."""
    if not isinstance(broken.document, dict) or broken.deep or error is Hang:
        return broken
    document = broken.document
    for way in sorted(places(document), key=len):
        try:
            owner = at(document, way[:-1])
            kept = owner[way[-1]]
            del owner[way[-1]]
        except (IndexError, KeyError, TypeError):
            continue  # went with what it was part of
        try:
            judge(dataclasses.replace(broken, document=document))
            fails = False
        except error:
            fails = True
        except Exception:
            fails = False
        if not fails and isinstance(owner, list):
            owner.insert(way[-1], kept)
        elif not fails:
            owner[way[-1]] = kept
    return broken


def shown(document: Any, most: int = 20_000) -> str:
    """A document as JSON where it can be, to be fed in again."""
    if isinstance(document, str):
        return document
    digits = sys.get_int_max_str_digits()
    sys.set_int_max_str_digits(0)  # Python writes no whole number of thousands of digits
    try:
        return json.dumps(document, default=repr)[:most]
    except (TypeError, ValueError, RecursionError):
        with contextlib.suppress(RecursionError):
            if not _deep(document):
                return repr(document)[:most]
        return "[" * 5000
    finally:
        sys.set_int_max_str_digits(digits)


def _deep(item: Any, depth: int = 0) -> bool:
    if depth > 200:
        return True
    inner = item.values() if isinstance(item, dict) else item if isinstance(item, list) else ()
    return any(_deep(x, depth + 1) for x in inner)
