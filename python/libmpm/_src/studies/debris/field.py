"""A debris field as a value: its pieces, and what can be asked of it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt

from libmpm._src.base.arguments import keywords_only
from libmpm._src.base.declarations import given
from libmpm._src.base.values import Checker, Value, sequence, value
from libmpm._src.errors import SceneError
from libmpm._src.output.atomic_files import write_json
from libmpm._src.shapes.oriented_boxes import cosine_sine
from libmpm._src.studies.debris.files import write_csv
from libmpm._src.studies.debris.laws import Angles
from libmpm._src.studies.debris.places import above, check_apart, check_clear, check_inside, seen
from libmpm._src.studies.debris.prototype import MOST_PIECES, Piece, Prototype, check_prototypes
from libmpm._src.studies.debris.rectangles import Rectangles, gaps, obliquity, rounded

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from libmpm._src.base.formulas import Field
    from libmpm._src.methods.method import FBar
    from libmpm._src.scene.scene import Scene
    from libmpm._src.studies.debris.mesh import DebrisMesh

__all__ = ["DebrisField", "Placement"]


@value
class Placement(Value):
    """How a field was made.

    {fields}
    """

    label: ClassVar[str] = "debris.Placement"

    kind: Literal["ordered", "random", "given"] = given(
        '"ordered", "random", or "given" by hand', default="given"
    )
    seed: int | None = given(
        "of the random numbers; None = none were drawn", default=None, unit="1", low=0, whole=True
    )
    angles: Angles | None = given("law of the angles", default=None)
    interval: tuple[float, float] | None = given(
        "of the angles, as drawn for this field", default=None, unit="degrees", shape="(2,)"
    )
    attempts: int = given("places drawn for pieces, in all restarts together", default=0, unit="1")
    outside: int = given("of these, with a corner outside of the footprint", default=0, unit="1")
    too_close: int = given(
        "of these, nearer to another piece than the clearance", default=0, unit="1"
    )
    restarts: int = given("times the field was begun again", default=0, unit="1")
    skipped: int = given("combinations of count, size and porosity rejected", default=0, unit="1")
    rejected: int = given("samples that could not be placed, before this one", default=0, unit="1")

    def _check(self, check: Checker) -> dict[str, Any]:
        found: dict[str, Any] = {
            name: check.integer(name, getattr(self, name))
            for name in ("attempts", "outside", "too_close", "restarts", "skipped", "rejected")
        }
        check.choice("kind", self.kind, ("ordered", "random", "given"))
        if self.seed is not None:
            found["seed"] = check.given("seed", self)
        if self.angles is not None:
            check.instance("angles", self.angles, (Angles,), "a law such as debris.UniformAngles()")
        if self.interval is not None:
            found["interval"] = check.given("interval", self)
        return found


@value
class DebrisField(Value):
    """Pieces of debris in the plan, x along the flow, y across it, and how they were placed.

    {fields}

    Made by `ordered` and `random`, or from pieces of your own, such as those of a photograph.
    Those of your own lie in the footprint, or its porosity would be wrong, and keep the clearance:
    side by side in the plan, above each other not. Raises `SceneError`. Source: Bonus (2023) 10.
    """

    label: ClassVar[str] = "debris.DebrisField"

    prototypes: Sequence[Prototype] = given("kinds of debris")
    pieces: Sequence[Piece] = given("`debris.Piece` values, 5000 at most; no two may overlap")
    corner: Sequence[float] = given(
        "lower corner of the footprint", default=(0.0, 0.0), unit="m", shape="(2,)"
    )
    footprint: Sequence[float] = given(
        "(lx, ly), edges of the rectangle that porosity refers to", unit="m", shape="(2,)", above=0
    )
    rotation: float = given(
        "of the whole about the middle of the footprint: pieces are where they stand, the "
        "footprint is turned by it",
        default=0.0,
        unit="degrees",
    )
    clearance: float = given(
        "gap in the plan that every two pieces were given", default=0.0, unit="m", low=0
    )
    placement: Placement = given("how the field was made", default=Placement())

    def _check(self, check: Checker) -> dict[str, Any]:
        prototypes = check_prototypes(self.label, self.prototypes)
        pieces = sequence(self.pieces)
        if pieces is None or not all(isinstance(p, Piece) for p in pieces):
            check.fail("pieces is no sequence of debris.Piece(x=, y=, angle=)")
            pieces = []
        if len(pieces) > MOST_PIECES:
            check.fail(f"pieces are {len(pieces)}; expected at most {MOST_PIECES}; use fewer, or "
                       "several fields: all pairs are compared")  # fmt: skip
            pieces = []
        footprint = check.given("footprint", self)
        for a, edge in enumerate(footprint):
            if edge <= 0:
                check.fail(f"footprint[{a}] is {edge:g}; expected > 0 m")
        for i, piece in enumerate(pieces):
            if piece.prototype >= len(prototypes):
                check.fail(
                    f"pieces[{i}].prototype is {piece.prototype}; expected 0 to "
                    f"{len(prototypes) - 1}, the prototypes given"
                )
        check.instance("placement", self.placement, (Placement,), "debris.Placement()")
        if not check.problems:
            check_apart(check, prototypes, pieces)
        corner = check.given("corner", self)
        turn = check.given("rotation", self)
        clearance = check.given("clearance", self)
        # The other kinds are made so that both hold.
        if not check.problems and pieces and self.placement.kind == "given":
            rectangles = seen(prototypes, pieces)
            check_inside(check, rectangles, corner, footprint, turn)
            check_clear(check, rectangles, above(prototypes, pieces), clearance)
        return {
            "prototypes": prototypes,
            "pieces": tuple(pieces),
            "corner": corner,
            "footprint": footprint,
            "rotation": turn,
            "clearance": clearance,
        }

    def __len__(self) -> int:
        """Return the number of pieces."""
        return len(self.pieces)

    def __repr__(self) -> str:
        """Return a line with the field's size."""
        size = " × ".join(f"{edge:g}" for edge in self.footprint)
        return f"<debris.DebrisField: {len(self)} pieces in {size} m, {self.placement.kind}>"

    # Geometry ------------------------------------------------------------------------------

    @property
    def middle(self) -> tuple[float, float]:
        """Middle of the footprint, m."""
        x, y = (c + 0.5 * edge for c, edge in zip(self.corner, self.footprint, strict=True))
        return x, y

    def outline(self) -> npt.NDArray[np.float64]:
        """Return the corners of the footprint, counterclockwise, (4, 2) m."""
        x, y = self.middle
        parts = (x, y, self.rotation, *self.footprint)
        found: npt.NDArray[np.float64] = Rectangles(
            *(np.array([part]) for part in parts)
        ).corners()[0]
        return found

    def rectangles(self) -> Rectangles:
        """Return the pieces as seen in the plan."""
        return seen(self.prototypes, self.pieces)

    def gaps(self) -> npt.NDArray[np.float64]:
        """Return the clear gap between every two pieces, (n, n) m; infinite on the diagonal."""
        rectangles = self.rectangles()
        plan = gaps(rectangles, rectangles)
        up = above(self.prototypes, self.pieces).clip(0.0)
        found = np.sqrt(plan**2 + up**2)
        np.fill_diagonal(found, np.inf)
        made: npt.NDArray[np.float64] = found
        return made

    def table(self) -> npt.NDArray[np.void]:
        """Return one row a piece, a record array.

        Columns: `prototype` and `name`; `x`, `y`, `elevation` (m); `angle`, `obliquity` (degrees;
        the angle against x folded to [0, 90]); `length`, `width`, `height` (m); `mass` (kg); `gap`
        (m, to the nearest other piece, infinite for a single one).
        """
        kinds = [self.prototypes[p.prototype] for p in self.pieces]
        nearest = self.gaps().min(axis=1, initial=np.inf)
        columns: dict[str, Any] = {
            "prototype": [p.prototype for p in self.pieces],
            "name": [k.name for k in kinds],
            **{key: [getattr(p, key) for p in self.pieces] for key in ("x", "y", "elevation")},
            "angle": [p.angle for p in self.pieces],
            "obliquity": obliquity([p.angle for p in self.pieces]),
            **{key: [getattr(k, key) for k in kinds] for key in ("length", "width", "height")},
            "mass": [k.mass for k in kinds],
            "gap": nearest,
        }
        types = {"prototype": "i8", "name": f"U{max((len(k.name) for k in kinds), default=1)}"}
        found = np.empty(len(self), dtype=[(key, types.get(key, "f8")) for key in columns])
        for key, column in columns.items():
            found[key] = column
        return found

    @keywords_only("debris.DebrisField.moved", 1)
    def moved(self, by: Sequence[float]) -> DebrisField:
        """Return the field moved by (dx, dy) m, to 1e-9."""
        check = Checker(f"{self.label}.moved")
        way = rounded(check.vector("by", by, lengths=(2,), unit="m"))
        check.finish()
        place = [rounded(np.array([p.x, p.y]) + way).tolist() for p in self.pieces]
        corner = rounded(np.array(self.corner) + way).tolist()
        return self._placed(place, 0.0, corner=corner)

    @keywords_only("debris.DebrisField.turned", 1)
    def turned(self, angle: float) -> DebrisField:
        """Return the field turned by degrees, counterclockwise, about the middle of its footprint.

        Gaps stay, to the 1e-9 m that positions are kept to; angles against the flow and extents
        change.
        """
        check = Checker(f"{self.label}.turned")
        angle = check.number("angle", angle, unit="degrees")
        check.finish()
        c, s = cosine_sine(angle)
        x0, y0 = self.middle
        arms = [(p.x - x0, p.y - y0) for p in self.pieces]
        place = [rounded([x0 + u * c - v * s, y0 + u * s + v * c]).tolist() for u, v in arms]
        return self._placed(place, angle, rotation=self.rotation + angle)

    def _placed(self, places: list[list[float]], turn: float, **changes: Any) -> DebrisField:
        """Return the field with its pieces elsewhere, turned by degrees."""
        pieces = [
            Piece(prototype=p.prototype, x=x, y=y, angle=p.angle + turn, elevation=p.elevation)
            for p, (x, y) in zip(self.pieces, places, strict=True)
        ]
        kept = ("prototypes", "corner", "footprint", "rotation", "clearance", "placement")
        fields = {key: getattr(self, key) for key in kept} | {"pieces": pieces} | changes
        return DebrisField(**fields)

    # Measures ------------------------------------------------------------------------------

    @keywords_only("debris.DebrisField.obliquity", 1)
    def obliquity(self, flow: float = 0.0) -> npt.NDArray[np.float64]:
        """Return the angles between long edges and the flow, folded to [0, 90], (n,) degrees.

        `flow` is the direction of the flow, or the normal of the structure, in degrees against x.
        """
        return obliquity([p.angle - flow for p in self.pieces])

    @keywords_only("debris.DebrisField.share_below", 1)
    def share_below(self, theta: float, *, flow: float = 0.0) -> float:
        """Return the share of pieces with an obliquity < theta degrees; θ15 is that of 15.

        Raises `SceneError`.
        """
        return float(np.mean(self._some_angles("share_below", theta, flow) < theta))

    @keywords_only("debris.DebrisField.share_above", 1)
    def share_above(self, theta: float, *, flow: float = 0.0) -> float:
        """Return the share D_θ of pieces with an obliquity ≥ theta degrees.

        Raises `SceneError`.
        """
        return float(np.mean(self._some_angles("share_above", theta, flow) >= theta))

    def _some_angles(self, method: str, theta: float, flow: float) -> npt.NDArray[np.float64]:
        check = Checker(f"{self.label}.{method}")
        check.number("theta", theta, unit="degrees")
        check.number("flow", flow, unit="degrees")
        if not self.pieces:
            check.fail("there are no pieces; expected some to measure")
        check.finish()
        return self.obliquity(flow)

    @keywords_only("debris.DebrisField.metadata")
    def metadata(
        self,
        *,
        width: float | None = None,
        flow: float = 0.0,
        footprint: Literal["square"] | float | Sequence[float] | None = None,
        thetas: Sequence[float] = (15, 30, 45, 60, 75),
    ) -> dict[str, Any]:
        """Return every variable of the field, for JSON and for tables.

        Plain numbers, but for how the field was made ("kind", "angles", "interval") and the list
        "prototypes" of its kinds of debris. The distribution of the angles is in `angle_data`.

        =========  =======  ===============================================================
        parameter  unit     meaning
        =========  =======  ===============================================================
        width      m        W of the structure's face; None leaves L_x/W and L_y/W undefined
        flow       degrees  direction of the flow or of the structure's normal against x
        footprint  m        area for the porosity: None = the field's own footprint, "square" =
                            the smallest square along the flow that holds the field, L = a
                            square of that edge, or (lx, ly)
        thetas     degrees  angles θ of the shares D_θ
        =========  =======  ===============================================================

        The page on debris fields tables the keys. Undefined ones are None: log_n at n = 0; C_u and
        C_c where D10 (or D60) is 0; s of a single piece. Raises `SceneError`. Source: Bonus (2023)
        10.2.
        """
        from libmpm._src.studies.debris.metadata import metadata

        return metadata(self, width=width, flow=flow, footprint=footprint, thetas=thetas)

    @keywords_only("debris.DebrisField.angle_data")
    def angle_data(self, *, bins: int = 6, flow: float = 0.0) -> dict[str, Any]:
        """Return the numbers behind rose, histogram and cumulative curve, for JSON.

        "obliquity" sorted (n,) and "cumulative" (n,), the share of pieces with at most that angle;
        "edges" (bins + 1,) and "counts", "shares" (bins,); "D10", "D30", "D60"; in degrees.
        """
        from libmpm._src.studies.debris.metadata import angle_data

        return angle_data(self, bins=bins, flow=flow)

    # Use -----------------------------------------------------------------------------------

    @keywords_only("debris.DebrisField.add_to", 1)
    def add_to(
        self,
        scene: Scene,
        *,
        elevation: float = 0.0,
        velocity: Sequence[float] | Field | None = None,
        name: str = "debris",
        subtract_from: Sequence[str] = (),
        fbar: FBar | Literal["default"] | None = "default",
        edge: float | None = None,
    ) -> tuple[str, ...]:
        """Add a body for every piece to a scene and return their names, in the pieces' order.

        =============  ====  ================================================================
        parameter      unit  meaning
        =============  ====  ================================================================
        elevation      m     z of the field's lowest layer; 3D alone
        velocity       m/s   of all bodies at the start, or a `libmpm.Field`; None = at rest
        name           -     bodies are called name-1, name-2, ...
        subtract_from  -     bodies that lose their particles inside the debris, such as water
        fbar           -     see `Scene.add_body`
        edge           m     of bodies of elements (`shapes.Tetrahedra.box`); None = of particles
        =============  ====  ================================================================

        In 3D the plan is x, y, and z points up. A 2D scene is the plan itself, in plane strain.
        Raises `SceneError`, and then adds nothing.
        """
        from libmpm._src.studies.debris.bodies import add_to

        return add_to(
            self,
            scene,
            elevation=elevation,
            edge=edge,
            velocity=velocity,
            name=name,
            subtract_from=subtract_from,
            fbar=fbar,
        )

    @keywords_only("debris.DebrisField.mesh")
    def mesh(self, *, edge: float | None = None, elevation: float = 0.0) -> DebrisMesh:
        """Return the pieces as tetrahedra, for finite elements.

        `edge` in m is the longest edge of the bricks that a piece is cut into; None = one brick.
        Each brick gives six tetrahedra, which match across bricks. Raises `SceneError`.
        """
        from libmpm._src.studies.debris.mesh import mesh

        return mesh(self, edge=edge, elevation=elevation)

    @keywords_only("debris.DebrisField.save_mesh", 1)
    def save_mesh(
        self, path: str | Path, *, edge: float | None = None, elevation: float = 0.0
    ) -> None:
        """Write `mesh` to a file of a kind that meshio knows by its suffix, such as .vtu or .inp.

        Each tetrahedron carries the number of its "piece" and "prototype". Raises `SceneError`.
        """
        from libmpm._src.studies.debris.mesh import save_mesh

        save_mesh(self, Path(path), edge=edge, elevation=elevation)

    # Files ---------------------------------------------------------------------------------

    @keywords_only("debris.DebrisField.save", 1)
    def save(self, path: str | Path) -> None:
        """Write the field to a JSON file, with its `metadata` to be read by others.

        `load` takes the field itself and measures it again. Raises `OutputError`.
        """
        measured = self.metadata() if self.pieces else None
        write_json(Path(path), self.to_dict() | {"metadata": measured})

    @classmethod
    @keywords_only("debris.DebrisField.load", 1)
    def load(cls, path: str | Path) -> DebrisField:
        """Read a field from a JSON file; raises `SceneError`."""
        try:
            data = json.loads(Path(path).read_text(encoding="utf-8"))
        except OSError as error:
            raise SceneError(f"{path}: cannot be read: {error}; correct the path") from error
        except (ValueError, RecursionError, MemoryError) as error:
            raise SceneError(
                f"{path}: not JSON: {error}; write it with debris.DebrisField.save"
            ) from error
        kept = data if isinstance(data, Mapping) else {}
        found: DebrisField = cls.from_dict({k: v for k, v in kept.items() if k != "metadata"})
        return found

    @keywords_only("debris.DebrisField.save_table", 1)
    def save_table(self, path: str | Path) -> None:
        """Write `table` to a CSV file with a line of column names; raises `OutputError`."""
        rows = self.table()
        write_csv(Path(path), rows.dtype.names or (), rows.tolist())

    @keywords_only("debris.DebrisField.report", 1)
    def report(
        self,
        folder: str | Path,
        *,
        width: float | None = None,
        flow: float = 0.0,
        footprint: Literal["square"] | float | Sequence[float] | None = None,
        thetas: Sequence[float] = (15, 30, 45, 60, 75),
        bins: int = 6,
    ) -> dict[str, Path]:
        """Write all that is known of the field to a folder and return the files by name.

        ==========  =============  ============================================
        name        file           holds
        ==========  =============  ============================================
        "field"     field.json     `save`
        "pieces"    pieces.csv     `save_table`
        "metadata"  metadata.json  `metadata`, with the arguments given here
        "angles"    angles.json    `angle_data`
        "figure"    field.png      `figure`
        ==========  =============  ============================================

        The folder is made if it is not there; files of these names are replaced. Raises
        `SceneError`, `OutputError`. Source: Bonus (2023) 10.4.
        """
        from libmpm._src.studies.debris.files import report

        measured = self.metadata(width=width, flow=flow, footprint=footprint, thetas=thetas)
        return report(self, Path(folder), measured, bins=bins, flow=flow)

    # Pictures ------------------------------------------------------------------------------

    @keywords_only("debris.DebrisField.draw", 1)
    def draw(self, ax: Axes | None = None) -> Axes:
        """Draw the plan to scale, with footprint and flow, and return the axes."""
        from libmpm._src.studies.debris.draw import draw

        return draw(self, ax)

    @keywords_only("debris.DebrisField.rose", 1)
    def rose(self, ax: Axes | None = None, *, bins: int = 6, flow: float = 0.0) -> Axes:
        """Draw shares of obliquities as a rose on polar axes, and return them."""
        from libmpm._src.studies.debris.draw import rose

        return rose(self, ax, bins=bins, flow=flow)

    @keywords_only("debris.DebrisField.histogram", 1)
    def histogram(self, ax: Axes | None = None, *, bins: int = 6, flow: float = 0.0) -> Axes:
        """Draw numbers of pieces against obliquity, and return the axes."""
        from libmpm._src.studies.debris.draw import histogram

        return histogram(self, ax, bins=bins, flow=flow)

    @keywords_only("debris.DebrisField.cumulative", 1)
    def cumulative(self, ax: Axes | None = None, *, flow: float = 0.0) -> Axes:
        """Draw the share of pieces up to an obliquity, with D10, D30, D60; return the axes."""
        from libmpm._src.studies.debris.draw import cumulative

        return cumulative(self, ax, flow=flow)

    @keywords_only("debris.DebrisField.figure")
    def figure(self, *, bins: int = 6, flow: float = 0.0) -> Figure:
        """Return a matplotlib figure of plan, rose, histogram and cumulative curve."""
        from libmpm._src.studies.debris.draw import figure

        return figure(self, bins=bins, flow=flow)
