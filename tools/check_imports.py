"""Fails when files of the Python package import each other in circles of more than a few.

Every import counts: at the top of a file, within functions, and for annotations alone
(TYPE_CHECKING). A circle is a set of files each of which leads to every other; whoever reads one of
them has to know all. Values lie below what uses them: `SceneData` below `Scene`, the protocol
`Running` below `Simulation`.

usage: check_imports.py [TREE]
"""

import argparse
import ast
import sys
from pathlib import Path

#: Files that may be in one circle.
MOST = 6
PACKAGE = "python/libmpm"


def modules_of(tree: Path) -> dict[str, Path]:
    """The modules of the package by name."""
    folder = tree / PACKAGE
    found = {}
    for path in sorted(folder.rglob("*.py")):
        parts = (folder.name, *path.relative_to(folder).with_suffix("").parts)
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imports_of(path: Path, known: dict[str, Path]) -> set[str]:
    """The modules of the package that a file imports, wherever it does."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [f"{node.module}.{a.name}" for a in node.names]
            found |= {name if name in known else node.module for name in names}
        elif isinstance(node, ast.Import):
            found |= {a.name for a in node.names}
    return {name for name in found if name in known}


def circles(graph: dict[str, set[str]]) -> list[list[str]]:
    """The strongly connected components of more than one file, the largest first (Tarjan 1972)."""
    number: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found = []
    for root in graph:
        if root in number:
            continue
        number[root] = low[root] = len(number)
        stack.append(root)
        path = [(root, iter(sorted(graph[root])))]
        while path:
            node, ahead = path[-1]
            for other in ahead:
                if other not in number:
                    number[other] = low[other] = len(number)
                    stack.append(other)
                    path.append((other, iter(sorted(graph[other]))))
                    break
                if other in stack:
                    low[node] = min(low[node], number[other])
            else:
                path.pop()
                if path:
                    low[path[-1][0]] = min(low[path[-1][0]], low[node])
                if low[node] == number[node]:
                    at = stack.index(node)
                    found.append(sorted(stack[at:]))
                    del stack[at:]
    return sorted((c for c in found if len(c) > 1), key=lambda c: (-len(c), c))


def check(tree: Path, most: int = MOST) -> list[str]:
    """One text for each circle that is too large, with the imports that close it."""
    known = modules_of(tree)
    graph = {name: imports_of(path, known) - {name} for name, path in known.items()}
    offences = []
    for circle in circles(graph):
        if len(circle) <= most:
            continue
        lines = [
            f"  {name} imports {', '.join(sorted(graph[name] & set(circle)))}" for name in circle
        ]
        offences.append(
            f"{len(circle)} files import each other in a circle, at most {most} may; put what they "
            "share into a file below them, or annotate with a protocol:\n" + "\n".join(lines)
        )
    return offences


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("tree", nargs="?", type=Path, default=Path(__file__).parents[1])
    offences = check(parser.parse_args().tree)
    print("\n".join(offences), file=sys.stderr, end="\n" if offences else "")
    return 1 if offences else 0


if __name__ == "__main__":
    sys.exit(main())
