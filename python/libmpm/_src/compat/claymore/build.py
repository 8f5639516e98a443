"""Scenes from the records of a ClaymoreUW file."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from libmpm._src.compat.claymore.boundaries import make_boundaries, walls_of
from libmpm._src.compat.claymore.contact import Made, Setting
from libmpm._src.compat.claymore.flumes import bed_of
from libmpm._src.compat.claymore.geometry import Fit, cut, files_of, overlap, shapes_of
from libmpm._src.compat.claymore.materials import fbar_of, material_of, transfers_of
from libmpm._src.compat.claymore.parse import read_scene
from libmpm._src.compat.claymore.reader import Context
from libmpm._src.compat.claymore.records import BodyRecord, SceneRecord
from libmpm._src.compat.claymore.sensors import make_sensors, make_trackers, output_names
from libmpm._src.errors import SceneError
from libmpm._src.materials.material import wave_speed
from libmpm._src.methods.method import Method
from libmpm._src.scene.parts import Boundary
from libmpm._src.scene.run_file import RunFile, RunSettings
from libmpm._src.scene.scene import Scene
from libmpm._src.shapes.boxes import Box
from libmpm._src.shapes.solid import Solid

__all__ = ["Imported", "import_scene"]

#: Particles above which ids are not worked out for trackers: the bodies would have to be filled.
_COUNTED = 1e6
#: Cells of the domain on one axis, and their edge, m; beyond these, places in cells are no numbers.
_MOST_CELLS, _LEAST_CELL = 1e9, 1e-9


@dataclass(frozen=True)
class Imported:
    """A ClaymoreUW scene as a `Scene`, and what became of everything in its file.

    `scene` is the scene; `run` how long to run it and what to write, as the "run" key of a scene
    file; `notes` say where the scene is not what the file says, word for word; `ignored` lists
    every key without effect, with the reason.
    """

    scene: Scene
    run: RunSettings
    notes: list[str] = field(default_factory=list)
    ignored: list[str] = field(default_factory=list)

    def report(self) -> str:
        """Return all notes and ignored keys as a text."""
        scene, run = self.scene, self.run
        lines = [repr(scene), f"until {run.until:g} s, a frame every {run.frame_interval:g} s"]
        for title, rows in (("Notes", self.notes), ("Without effect", self.ignored)):
            lines += ["", f"{title} ({len(rows)}):", *(f"  {row}" for row in rows or ["none"])]
        return "\n".join(lines)

    def run_file(self) -> RunFile:
        """Return scene and run settings as one value, as `libmpm run` reads them."""
        return RunFile(self.scene, self.run)


def import_scene(
    path: Path,
    *,
    cell_size: float | None,
    motion_folder: Path | None,
    checkpoint: Path | None,
) -> Imported:
    """Read a file and build its scene; see `libmpm.compat.claymore.load`."""
    context = Context(path.name)
    record = read_scene(path, context)
    context.finish()
    return _Builder(context, record, path, cell_size, motion_folder, checkpoint).build()


class _Builder:
    """Turns one record into a scene, in the units of the file; scaling comes last."""

    def __init__(
        self,
        context: Context,
        record: SceneRecord,
        path: Path,
        cell_size: float | None,
        motion_folder: Path | None,
        checkpoint: Path | None,
    ) -> None:
        self.context, self.record, self.checkpoint = context, record, checkpoint
        ratio = record.length_ratio
        self.cell_size = record.cell_size if cell_size is None else cell_size / ratio
        if cell_size is not None and self.cell_size != record.cell_size:
            context.note(
                f"simulation.default_dx is {record.cell_size * ratio:g} m; cells of {cell_size:g} "
                "m are taken"
            )
        walls = walls_of(context, record.boundaries)
        lower: Sequence[float] = (0.0, 0.0, 0.0)
        upper: Sequence[float] = record.domain
        if walls is not None and walls.lower is not None and walls.upper is not None:
            lower, upper = walls.lower, walls.upper
            if any(b <= a for a, b in zip(lower, upper, strict=True)):
                context.fail(
                    walls.path, f"span {list(lower)} to {list(upper)}; expected end > start"
                )
            context.finish()
        else:
            context.note("there are no walls: what leaves the domain is removed and listed")
        wide = max(b - a for a, b in zip(lower, upper, strict=True))
        if self.cell_size < _LEAST_CELL or not wide < _MOST_CELLS * self.cell_size:
            context.fail(
                "simulation" if walls is None else walls.path,
                f"is {wide:g} m wide with cells of {self.cell_size:g} m; expected cells of "
                f"{_LEAST_CELL:g} m at least, and fewer than {_MOST_CELLS:g} on an axis",
            )
            context.finish()
        self.fit = Fit.around(lower, upper, self.cell_size)
        for text in self.fit.moved_walls():
            context.note(text)
        duration = record.frames / record.fps
        self.setting = Setting(
            self.fit, record.time, duration, motion_folder or path.parent, record.gravity
        )
        self.folder = path.parent
        self.closed = walls is not None

    def build(self) -> Imported:
        """Return the scene with everything said about it."""
        context, record = self.context, self.record
        bodies = self._merged()
        made = make_boundaries(context, record.boundaries, self.setting)
        if self.checkpoint is not None:
            return self._continued(bodies, made)
        shapes = [self._shapes(body, made) for body in bodies]
        context.finish()
        scene = self._empty(bodies)
        members = self._add_bodies(scene, bodies, shapes)
        self._add_boundaries(scene, made, members)
        for name, sensor in make_sensors(context, record.sensors, self.fit):
            scene.add_sensor(name=name, sensor=sensor)
        context.finish()
        self._add_trackers(scene, members)
        return self._finished(scene, members)

    def _merged(self) -> list[BodyRecord]:
        """Return the bodies, with those that several devices share taken once."""
        found: list[BodyRecord] = []
        parts: list[list[BodyRecord]] = []
        for body in self.record.bodies:
            for i, first in enumerate(found):
                if first.same_as(body):
                    parts[i].append(body)
                    break
            else:
                found.append(body)
                parts.append([body])
        for first, alike in zip(found, parts, strict=True):
            if len(alike) > 1:
                others = ", ".join(b.path for b in alike[1:])
                self.context.note(
                    f"{first.path}: {others} are the same body on other devices; taken once"
                )
            self._note_partitions(first, [b.partition for b in alike if b.partition is not None])
        return found

    def _note_partitions(
        self, body: BodyRecord, boxes: Sequence[tuple[Sequence[float], Sequence[float]]]
    ) -> None:
        """Say that partitions have no effect, and where ClaymoreUW would cut the body by them."""
        if not boxes:
            return
        self.context.ignored.append(
            f"{body.path}: partition_start, partition_end: the plan places the work on devices"
        )
        low = [min(x) for x in zip(*(b[0] for b in boxes), strict=True)]
        high = [max(x) for x in zip(*(b[1] for b in boxes), strict=True)]
        slack = 1e-6 * self.record.cell_size
        for one in body.geometry:
            ways = [(n - 1) * by for n, by in zip(one.array, one.spacing, strict=True)]
            near = [x + min(way, 0.0) for x, way in zip(one.offset, ways, strict=True)]
            far = [
                x + s + max(way, 0.0) for x, s, way in zip(one.offset, one.span, ways, strict=True)
            ]
            inside = all(a >= b - slack for a, b in zip(near, low, strict=True))
            if not inside or any(a > b + slack for a, b in zip(far, high, strict=True)):
                self.context.note(
                    f"{one.path}: reaches out of the partitions, {low} to {high} m, beyond which "
                    "ClaymoreUW drops it; it is kept"
                )

    def _shapes(self, body: BodyRecord, made: Sequence[Made]) -> list[Any]:
        """Return what a body fills, less what boundaries block when the run begins."""
        if any(g.object == "file" for g in body.geometry):
            size = math.prod([self.record.cell_size] * 3) / body.ppc
            return list(files_of(self.context, body, self.folder, size))
        beds = [bed for bed in map(bed_of, self.record.boundaries) if bed is not None]
        found = []
        for solid in shapes_of(self.context, body, self.fit, beds):
            rest: Solid | None = solid
            # Boxes first: a box cut by one may stay a box.
            for one in sorted(made, key=lambda m: not isinstance(m.blocks, Box)):
                if one.blocks is None or rest is None:
                    continue
                before, rest = rest, cut(rest, one.blocks, self.cell_size)
                if rest is not None and rest is not before and one.beyond is not None:
                    rest = cut(rest, one.beyond, self.cell_size)
                if rest is not before:
                    how = "nothing is left of a part of it" if rest is None else "it is cut there"
                    self.context.note(
                        f"{body.path}: boundary '{one.name}' stands in the body; {how}"
                    )
            if rest is not None:
                found.append(rest)
        if not found and not self.context.problems:
            self.context.fail(
                body.path,
                "has nothing in the domain that no boundary blocks; expected something to fill; "
                "correct its geometry",
            )
        return found

    def _empty(self, bodies: Sequence[BodyRecord]) -> Scene:
        transfer, _ = transfers_of(self.context, bodies)
        cfl = min(body.cfl for body in bodies)
        if len({body.cfl for body in bodies}) > 1:
            self.context.note(f"the smallest CFL of the bodies, {cfl:g}, holds for all")
        return Scene(
            dimension=3,
            cell_size=self.cell_size,
            lower=self.fit.lower,
            upper=self.fit.upper,
            gravity=self.record.gravity,
            method=Method(
                cfl=cfl,
                time_step=self._time_step(bodies, cfl),
                transfer=transfer,
                leaving="stop" if self.closed else "delete",
            ),
            name=self.record.name,
        )

    def _time_step(self, bodies: Sequence[BodyRecord], cfl: float) -> float | None:
        """Return default_dt where it is below the stable step, as an upper bound is meant."""
        given = self.record.time_step
        speeds = [wave_speed(material_of(self.context, body)) or 0.0 for body in bodies]
        stable = cfl * self.cell_size / max(speeds) if max(speeds) > 0 else math.inf
        if given is not None:
            given *= self.cell_size / self.record.cell_size
        if given is None or given >= 0.95 * stable:
            return None
        self.context.note(
            f"simulation.default_dt, {given:.6g} s with these cells, is below the stable step, "
            f"about {stable:.3g} s, and is kept; Method(time_step=None) would be faster"
        )
        return given

    def _add_bodies(
        self, scene: Scene, bodies: Sequence[BodyRecord], shapes: Sequence[Sequence[Any]]
    ) -> list[tuple[BodyRecord, list[str]]]:
        _, transfers = transfers_of(self.context, bodies)
        names = self._names(bodies)
        placed: list[tuple[str, Any, bool]] = []
        members = []
        for body, solids, name, transfer in zip(bodies, shapes, names, transfers, strict=True):
            material = material_of(self.context, body)
            ppc = max(1, round(body.ppc))
            if ppc != body.ppc:
                self.context.note(f"{body.path}: {body.ppc:g} particles per cell are {ppc}")
            own = []
            for i, solid in enumerate(solids):
                called = name if len(solids) == 1 else f"{name}-{i + 1}"
                fluid = body.law == "fluid"
                scene.add_body(
                    name=called,
                    shape=solid,
                    material=material,
                    particles_per_cell=ppc,
                    velocity=body.velocity,
                    fbar=fbar_of(self.context, body, material),
                    transfer=transfer,
                    subtract_from=self._displaced(called, solid, fluid, placed),
                )
                placed.append((called, solid, fluid))
                own.append(called)
            if len(solids) > 1:
                self.context.note(f"{body.path}: its {len(solids)} parts are bodies of their own, "
                                  f"'{own[0]}' to '{own[-1]}'")  # fmt: skip
            members.append((body, own))
        return members

    def _names(self, bodies: Sequence[BodyRecord]) -> list[str]:
        """Return a name for every body: its own, or what it is made of."""
        solids = sum(body.law != "fluid" for body in bodies)
        found: list[str] = []
        for body in bodies:
            fallback = "water" if body.law == "fluid" else "debris" if solids == 1 else body.law
            wanted = body.name.replace("/", "-").strip() or fallback
            tries = itertools.chain([wanted], (f"{wanted}{i}" for i in itertools.count(2)))
            found.append(next(n for n in tries if n not in found))
        return found

    def _displaced(
        self, name: str, solid: Any, fluid: bool, placed: Sequence[tuple[str, Any, bool]]
    ) -> tuple[str, ...]:
        """Return the earlier bodies that lose what lies inside this one."""
        if not isinstance(solid, Solid):
            return ()
        found = []
        for other, shape, _ in placed:
            if isinstance(shape, Solid) and overlap(shape, solid, self.cell_size) > 0:
                found.append(other)
                self.context.note(
                    f"bodies '{other}' and '{name}' overlap; the latter displaces the former, "
                    "where ClaymoreUW has both"
                )
        return tuple(found)

    def _add_boundaries(
        self, scene: Scene, made: Sequence[Made], members: Sequence[tuple[BodyRecord, list[str]]]
    ) -> None:
        limited = any(f.name == "bodies" for f in dataclasses.fields(Boundary))
        solids = tuple(n for body, names in members for n in names if body.law != "fluid")
        for one in made:
            arguments = dict(one.arguments)
            if one.solids_only and not (limited and solids):
                self.context.note(f"boundary '{one.name}': its friction is left out; it would hold "
                                  "the water too")  # fmt: skip
                continue
            if one.solids_only:
                arguments["bodies"] = solids
            try:
                scene.add_boundary(name=one.name, **arguments)
            except SceneError as error:
                self.context.problems += error.problems

    def _add_trackers(self, scene: Scene, members: Sequence[tuple[BodyRecord, list[str]]]) -> None:
        followed = [(body, names) for body, names in members if body.tracked and body.tracks]
        if not followed:
            return
        if _estimate(scene) > _COUNTED:
            self.context.note(
                "track_particle_id is left out: numbering the particles would fill all bodies "
                "now; add sensors.BodyTracker or AttributeTracker where wanted"
            )
            return
        from libmpm._src.scene.places import body_counts

        try:
            counts = dict(zip([b.name for b in scene.bodies], body_counts(scene), strict=True))
        except SceneError as error:
            self.context.note(f"track_particle_id is left out: {error}")
            return
        interval = 1.0 / self.record.fps
        for name, sensor in make_trackers(self.context, scene, followed, counts, interval):
            scene.add_sensor(name=name, sensor=sensor)

    def _continued(self, bodies: Sequence[BodyRecord], made: Sequence[Made]) -> Imported:
        """Return the scene that continues from a checkpoint of the scene that made the file's."""
        context = self.context
        assert self.checkpoint is not None
        scene = Scene.from_checkpoint(self.checkpoint)
        have = {body.name for body in scene.bodies}
        members = []
        for body, name in zip(bodies, self._names(bodies), strict=True):
            own = [n for n in have if n == name or n.rpartition("-")[0] == name]
            if not own:
                context.fail(
                    body.path,
                    f"is '{name}', which {self.checkpoint} does not have; its bodies are "
                    f"{', '.join(sorted(have))}; give one of the scene that wrote the file",
                )
            members.append((body, sorted(own)))
        walls = {b.name for b in scene.boundaries}
        self._add_boundaries(scene, [m for m in made if m.name not in walls], members)
        sensors = {s.name for s in scene.sensors}
        for name, sensor in make_sensors(context, self.record.sensors, self.fit):
            if name not in sensors:
                scene.add_sensor(name=name, sensor=sensor)
        context.finish()
        context.note(
            f"bodies, boundaries and numbers are those of {self.checkpoint} where they have the "
            "same names; the file's geometry is not used"
        )
        return self._finished(scene, members)

    def _finished(self, scene: Scene, members: Sequence[tuple[BodyRecord, list[str]]]) -> Imported:
        context, record = self.context, self.record
        outputs = {
            name: output_names(context, body, scene, name)
            for body, names in members
            for name in names
        }
        ratio = record.length_ratio
        duration = record.frames / record.fps
        begins = 0.0 if scene.start is None else scene.start.time
        if ratio != 1:
            scene = scene.scaled(ratio, cauchy=record.cauchy)
            duration *= math.sqrt(ratio)
            context.note(
                f"froude_scaling {ratio:g}: lengths × {ratio:g}, times and velocities × "
                f"{math.sqrt(ratio):.4g}, density, moduli and gravity as they are; intervals of "
                "sensors × the same as times, unlike in ClaymoreUW"
            )
        run = RunSettings(
            until=begins + duration,
            frame_interval=1.0 / record.fps,
            attributes=outputs if any(body.output for body, _ in members) else None,
            debris=[n for body, names in members for n in names if body.law != "fluid"]
            if any(body.law == "fluid" for body, _ in members) else [],
        )  # fmt: skip
        return Imported(scene, run, list(context.notes), list(context.ignored))


def _estimate(scene: Scene) -> float:
    """Return about how many particles a scene has, at most."""
    total = 0.0
    for body in scene.bodies:
        if isinstance(body.shape, Solid):
            low, high = body.shape.bounds()
            cells = math.prod((b - a) / scene.cell_size for a, b in zip(low, high, strict=True))
            total += cells * body.particles_per_cell
    return total
