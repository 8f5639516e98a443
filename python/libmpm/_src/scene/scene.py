"""`Scene`: everything that defines a simulation, and what one does with it before it runs."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self, overload

from libmpm._src.base.arguments import file_path, keywords_only
from libmpm._src.base.declarations import documents
from libmpm._src.scene.data import HEAD, SCHEMA, Body, Boundary, PlacedSensor, SceneData

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pyvista import Plotter

    from libmpm._src.advice.result import Advice
    from libmpm._src.run.plan import Plan
    from libmpm._src.shapes.boxes import Box

__all__ = ["HEAD", "SCHEMA", "Body", "Boundary", "PlacedSensor", "Scene"]


@documents(HEAD)
class Scene(SceneData):
    """A simulation as plain values: domain, bodies, boundaries and sensors.

    {fields}

    Scenes compare equal when all their values do, can be pickled, and round-trip through
    `to_dict`, `from_dict`, `save` and `load`. Raises `SceneError` with all problems.
    """

    @keywords_only("Scene.copy")
    def copy(self, **changes: Any) -> Self:
        """Return a scene of its own with the same parts and some arguments of `Scene` changed.

        ``scene.copy(cell_size=0.01, name="fine")``: parts that are added to one of the two, or
        changed, stay as they are in the other. How bodies are filled by default follows a change
        of gravity. A scene that continues from a checkpoint can be copied as it is alone. Raises
        `SceneError`.
        """
        from libmpm._src.scene.changes import copied

        return copied(self, changes)

    def __copy__(self) -> Self:
        """Return a scene of its own: `copy`."""
        return self.copy()

    @keywords_only("Scene.replace", 1)
    def replace(self, name: str, *, kind: str | None = None, **changes: Any) -> None:
        """Change what was given of a body, boundary, sensor, flow or contact, by its name.

        ``scene.replace("water", velocity=(1.0, 0.0))`` takes the arguments of `add_body`,
        `add_boundary` and `add_contact`; of a sensor or flow those of the value that was added, as
        in ``scene.replace("load", interval=1e-3)``. `kind`, "body", "boundary", "sensor", "flow" or
        "contact", is needed where several have the name. The part keeps its name and its place
        among the others; how a body is filled by default follows its shape and material. Raises
        `SceneError`; `validate` checks what concerns several objects.
        """
        from libmpm._src.scene.changes import replace

        replace(self, name, kind, changes)

    @keywords_only("Scene.remove", 1)
    def remove(self, name: str, *, kind: str | None = None) -> None:
        """Take a body, boundary, sensor, flow or contact out of the scene, by its name.

        `kind`, "body", "boundary", "sensor", "flow" or "contact", is needed where several have the
        name. Raises `SceneError`; what still names the part is refused by `validate`.
        """
        from libmpm._src.scene.changes import remove

        remove(self, name, kind)

    @keywords_only("Scene.validate")
    def validate(self, *, strict: bool = False) -> None:
        """Check the scene as a whole; raises `SceneError` with all problems.

        What can run but will be wrong by a stated amount is a `ModelWarning`, and a problem too
        where `strict` is true.
        """
        from libmpm._src.scene.checks import validate

        validate(self, strict=strict)

    @keywords_only("Scene.plan")
    def plan(
        self,
        *,
        device: str = "auto",
        precision: str = "auto",
        pipeline: str = "auto",
        until: float | None = None,
        time_step: float | None = None,
        threads: int = 0,
    ) -> Plan:
        """Return what a simulation would store, run and cost, without allocating it.

        `until` in s adds the number of steps and a cost estimate; `time_step` in s overrides that
        of the method; `threads` = 0 takes all. The device need not exist here. Raises
        `SceneError`.
        """
        from libmpm._src.run.plan import build_plan

        return build_plan(
            self,
            device=device,
            precision=precision,
            pipeline=pipeline,
            until=until,
            time_step=time_step,
            threads=threads,
        )

    @keywords_only("Scene.advise")
    def advise(
        self, *, error: float = 0.05, device: str = "auto", cases: Sequence[str] | None = None
    ) -> Advice:
        """Return numerical settings for this scene from the shipped atlas, with reasons.

        =========  ====  =======  =============================================================
        parameter  unit  range    meaning
        =========  ====  =======  =============================================================
        error      1     > 0      largest error of the cases' answers, parts of them
        device     -     a name   whose measurements are used: "auto", "cpu" or "cuda"
        cases      -     names    of the atlas that the scene is like; None = those whose rules fit
        =========  ====  =======  =============================================================

        The scene is matched to benchmark cases of the atlas by its features (`docs/advice.md`
        lists the rules); of the settings measured on all of them the cheapest within the error is
        proposed.
        Warnings say where the scene leaves the range of the measurements, and what no case covers.
        Nothing is run. Raises `SceneError`.
        """
        from libmpm._src.advice.advise import advise

        return advise(self, error=error, device=device, cases=cases)

    @keywords_only("Scene.scaled", 1)
    def scaled(self, length_ratio: float, *, cauchy: bool = False, reynolds: bool = False) -> Scene:
        """Return this scene in Froude similitude: every number takes the power of λ of its unit.

        ============  ====  =====  ==============================================================
        parameter     unit  range  meaning
        ============  ====  =====  ==============================================================
        length_ratio  1     > 0    λ = new length / length here, 0.1 for a model at 1:10
        cauchy        -     bool   moduli, strengths and whatever else a material has in Pa × λ,
                                   so that waves in it keep their place among the flow's
        reynolds      -     bool   viscosities × λ^1.5
        ============  ====  =====  ==============================================================

        Lengths × λ; velocities, times and intervals × λ^½; masses and forces × λ³; given stresses
        and tractions × λ; density, gravity and angles stay. Kept are v/√(gL) (Froude) always,
        ρv²/K (Cauchy, and with it v/c and the number of steps) with `cauchy`, ρvL/μ (Reynolds)
        with `reynolds` alone. A scene that continues from a checkpoint is refused. Raises
        `SceneError`. Source: Bonus (2023) eq. 7.2 and 7.3, `froude_scaling`.
        """
        from libmpm._src.scene.scaling import scale_scene

        return scale_scene(self, length_ratio, cauchy=cauchy, reynolds=reynolds)

    @overload
    def preview(
        self,
        *,
        backend: Literal["matplotlib"] = "matplotlib",
        planes: Sequence[str] | str | None = None,
        cut: Sequence[float] | None = None,
        most: int = 200_000,
    ) -> Figure: ...
    @overload
    def preview(self, *, backend: Literal["pyvista"], most: int = 200_000) -> Plotter: ...
    @keywords_only("Scene.preview")
    def preview(
        self,
        *,
        backend: Literal["matplotlib", "pyvista"] = "matplotlib",
        planes: Sequence[str] | str | None = None,
        cut: Sequence[float] | None = None,
        most: int = 200_000,
    ) -> Figure | Plotter:
        """Return a picture of the scene before it runs: particles, boundaries, walls, sensors.

        =========  ====  ===========  =====================================================
        parameter  unit  range        meaning
        =========  ====  ===========  =====================================================
        backend    -     a name       "matplotlib" returns a figure; "pyvista" a plotter in
                                      space, of 3D scenes, which `libmpm[viz]` brings
        planes     -     names        such as "xz", the first axis to the right; None = all
        cut        m     (3,)         a point in 3D that the planes go through: particles within
                                      a cell of them and the outlines there; None = seen through
        most       1     ≥ 1          particles drawn, always the same ones; the title says it
                                      where that is not all
        =========  ====  ===========  =====================================================

        Coordinates are those of the world. A scene that cannot run yet is drawn without its
        particles, under its first problem. Raises `Error`.
        """
        from libmpm._src.pictures.preview import preview

        return preview(self, backend=backend, planes=planes, cut=cut, most=most)

    @classmethod
    @keywords_only("Scene.from_checkpoint", 1)
    def from_checkpoint(
        cls,
        path: str | Path,
        *,
        tiles: int = 1,
        axis: str | None = None,
        within: Box | None = None,
    ) -> Scene:
        """Return a scene that continues from a checkpoint: water once, debris many times.

        Bodies, boundaries and sensors may be added to it. New bodies take the place of the
        particles of the bodies in their `subtract_from`, which are counted
        (`Simulation.displaced`); all others keep place, state and motion. With nothing but
        boundaries and sensors added, the run is bit for bit the one that wrote the checkpoint,
        gone on with, on the same backend, pipeline and precision.

        =========  ====  ==========  ======================================================
        parameter  unit  range       meaning
        =========  ====  ==========  ======================================================
        path       -     a file      of `Simulation.save_checkpoint`, or of a run's folder
        tiles      1     ≥ 1         copies of the run side by side, with ids of their own: a
                                     slice one cell thick becomes a flume
        axis       -     "x"|"y"|    across which they lie; needed with tiles > 1
                         "z"
        within     m     a `Box`     what is cut out of the run before it is tiled, moved out to
                                     faces of cells; None = all of it
        =========  ====  ==========  ======================================================

        A cut is the domain of the scene: what lies outside is gone, and `DomainWalls` stand at its
        faces. Boundaries and sensors that lie outside of it are left out, with a warning that
        names them; sensors begin again. What enters or leaves through its faces is for the caller
        to hold: by a piston that moves as the water did (`flumes.piston_of_flow`).

        The scene refers to the file by its path and SHA-256; it must stay where it is until the
        run has begun. Raises `CheckpointError` and `SceneError`.
        """
        from libmpm._src.scene.from_checkpoint import scene_from_checkpoint

        return scene_from_checkpoint(
            file_path(path, "Scene.from_checkpoint"), tiles, axis, within, read=cls.from_dict
        )

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Scene:
        """Build the scene that `to_dict` described; raises `SceneError` with all problems.

        A "run" key, with which `libmpm run` keeps its settings in the same file, is ignored.
        """
        from libmpm._src.scene.scene_file import SceneReader

        return SceneReader(cls, data).read()

    @keywords_only("Scene.save", 1)
    def save(self, path: str | Path) -> None:
        """Write the scene to a JSON file; one with a `sensors.Custom` is refused."""
        from libmpm._src.output.atomic_files import writing
        from libmpm._src.sensors.custom_functions import check_storable

        check_storable(self)
        text = json.dumps(self.to_dict(), indent=2, ensure_ascii=False, allow_nan=False)
        path = file_path(path, "Scene.save")
        # A file's name may hold bytes that are no text; JSON has a way to write them.
        with writing(path):
            path.write_text(text + "\n", encoding="utf-8", errors="backslashreplace")

    @classmethod
    @keywords_only("Scene.load", 1)
    def load(cls, path: str | Path) -> Scene:
        """Read a scene from a JSON file; raises `SceneError` with all problems.

        A "run" key, with which `libmpm run` keeps its settings in the same file, is ignored.
        """
        from libmpm._src.scene.scene_file import read_json

        return cls.from_dict(read_json(file_path(path, "Scene.load")))

    def _repr_html_(self) -> str:
        """Return the scene's parts as tables for Jupyter."""
        from libmpm._src.output.html import scene_html

        return scene_html(self)
