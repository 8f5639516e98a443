"""Fields of debris as files."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from libmpm._src.output.atomic_files import replacing, write_json, writing

if TYPE_CHECKING:
    from libmpm._src.studies.debris.field import DebrisField

__all__ = ["report", "write_csv"]


def write_csv(path: Path, head: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """Write a line of column names and rows; None stays empty. Raises `OutputError`."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(rows)
    with replacing(path) as part:
        part.write_text(text.getvalue(), encoding="utf-8", errors="backslashreplace")


def report(
    field: DebrisField, folder: Path, measured: dict[str, Any], *, bins: int, flow: float
) -> dict[str, Path]:
    """Write all that is known of a field; see `DebrisField.report`."""
    import matplotlib.pyplot as plt

    angles = field.angle_data(bins=bins, flow=flow)
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    names = {
        "field": "field.json",
        "pieces": "pieces.csv",
        "metadata": "metadata.json",
        "angles": "angles.json",
        "figure": "field.png",
    }
    paths = {key: folder / name for key, name in names.items()}
    field.save(paths["field"])
    field.save_table(paths["pieces"])
    write_json(paths["metadata"], measured)
    write_json(paths["angles"], angles)
    figure = field.figure(bins=bins, flow=flow)
    try:
        with replacing(paths["figure"]) as part:
            figure.savefig(part, format="png", dpi=150)
    finally:
        plt.close(figure)
    return paths
