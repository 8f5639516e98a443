"""Scenes of ClaymoreUW, the multi-GPU program of Bonus (2023), and of its front end HydroUQ.

>>> from libmpm.compat import claymore
>>> imported = claymore.load("scene.json")  # doctest: +SKIP
>>> print(imported.report())  # doctest: +SKIP
>>> sim = libmpm.Simulation(imported.scene)  # doctest: +SKIP
"""

from __future__ import annotations

from pathlib import Path

from libmpm._src.base.arguments import keywords_only
from libmpm._src.base.values import Checker
from libmpm._src.compat.claymore.build import Imported, import_scene

__all__ = ["Imported", "load"]


@keywords_only("compat.claymore.load", 1, method=False)
def load(
    path: str | Path,
    *,
    cell_size: float | None = None,
    motion_folder: str | Path | None = None,
    checkpoint: str | Path | None = None,
) -> Imported:
    """Read a scene of ClaymoreUW, in either dialect or inside a workflow file of HydroUQ.

    =============  ====  ========  =============================================================
    parameter      unit  range     meaning
    =============  ====  ========  =============================================================
    path           -     a file    JSON
    cell_size      m     > 0       other than the file's default_dx, for a coarser or finer run;
                                   after Froude scaling
    motion_folder  -     a folder  where motion files of paddles are; None = that of the file.
                                   A file is found by its path there, or by its name alone
    checkpoint     -     a file    of a run of this library, or its folder, that takes the place
                                   of the checkpoint which the scene continues from
    =============  ====  ========  =============================================================

    Axes stay as they are, y up. Both generations of key names are read, case and separators do not
    count, and all keys without effect are listed (`Imported.ignored`). Where the scene is not what
    stands in the file, `Imported.notes` says so; what cannot be honoured is refused: raises
    `SceneError` with all problems, each with its JSON path and what to do. The documentation has
    the table of keys.

    Source: Bonus (2023), chapter 4 and the scenes published with the program.
    """
    check = Checker("claymore.load")
    if cell_size is not None:
        cell_size = check.number("cell_size", cell_size, lower=0, lower_open=True, unit="m")
    check.finish()
    return import_scene(
        Path(path),
        cell_size=cell_size,
        motion_folder=None if motion_folder is None else Path(motion_folder),
        checkpoint=None if checkpoint is None else Path(checkpoint),
    )
