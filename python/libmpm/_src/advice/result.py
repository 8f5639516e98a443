"""What `Scene.advise` returns: settings with their reasons, what to expect, and warnings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from libmpm._src.advice.atlas import Row
from libmpm._src.advice.rules import Match
from libmpm._src.base.arguments import keywords_only
from libmpm._src.base.tables import html_table, html_warnings, pair_table, text_table
from libmpm._src.base.values import plain
from libmpm._src.boundaries.responses import DecayLayer
from libmpm._src.methods.method import FBar, Method

if TYPE_CHECKING:
    from libmpm._src.scene.scene import Scene

__all__ = ["Advice", "Reason", "Settings"]


@dataclass(frozen=True)
class Settings:
    """The settings proposed for a scene.

    ==================  ====  ================================================================
    field               unit  meaning
    ==================  ====  ================================================================
    method              -     `Method` with transfer, kernel and part of the stable step
    precision           -     of `Simulation`: "single", "mixed" or "double"
    fbar                -     F-bar by body; None = none
    particles_per_cell  1     by body, of those that it can be said of
    cell_size           m     edge of a cell, the present one over a whole number
    bulk_modulus        Pa    by body of water: the least that keeps the error
    mirrored            -     domain walls for which `boundaries.Mirror` is proposed
    linear              -     domain walls for which `Slip(cell="linear")` is proposed
    layer               -     `DecayLayer` of all surfaces; None = as they are
    ==================  ====  ================================================================
    """

    method: Method
    precision: str
    fbar: Mapping[str, FBar | None]
    particles_per_cell: Mapping[str, int]
    cell_size: float
    bulk_modulus: Mapping[str, float]
    mirrored: Sequence[str] = ()
    linear: Sequence[str] = ()
    layer: DecayLayer | None = None


@dataclass(frozen=True)
class Reason:
    """A setting in words: what it is, whether it changes, why, and how far it is applied."""

    setting: str
    value: str
    why: str
    changes: bool


@dataclass(frozen=True, repr=False)
class Advice:
    """Proposed settings of a scene, with the measurements that they come from.

    ===============  ====  ===================================================================
    field            unit  meaning
    ===============  ====  ===================================================================
    error            1     asked for, parts of the answer
    device           -     "cpu" or "cuda": whose measurements are used
    matches          -     cases of the atlas that fit the scene, with the reason
    settings         -     `Settings`; None where no case fits
    reasons          -     `Reason` of each setting
    expected_error   1     largest error of the settings on those cases; None without any
    reached          -     whether that is within `error`
    cost             1     time per simulated second, in that of the baseline (APIC without
                           F-bar) with the scene's own cells; None without any
    present_error    1     the same of the scene as it is; None where that was not measured
    present_cost     1     its cost
    lines            -     rows of the atlas that the settings come from
    warnings         -     where the scene leaves the range of the measurements, and what no
                           case covers
    source           -     version, commit and devices of the atlas
    ===============  ====  ===================================================================

    Prints as text, and as tables in Jupyter.
    """

    scene: Scene
    error: float
    device: str
    matches: Sequence[Match]
    settings: Settings | None
    reasons: Sequence[Reason]
    expected_error: float | None
    reached: bool
    cost: float | None
    present_error: float | None
    present_cost: float | None
    lines: Sequence[Row]
    warnings: Sequence[str]
    source: str
    refine: int = field(default=1)

    @keywords_only("advice.Advice.apply")
    def apply(self, *, cell_size: bool = False, bulk_modulus: bool = False) -> Scene:
        """Return a copy of the scene with the method, F-bar, particles and boundaries proposed.

        `cell_size` makes the cells smaller too where that is proposed, and `bulk_modulus` sets that
        of the water: both change what is computed and not only how. `Settings.precision` belongs
        to `Simulation`. Without settings the copy is equal to the scene.
        """
        from libmpm._src.scene.scene import Scene

        data = self.scene.to_dict()
        if self.settings is not None:
            self._change(data, self.settings, cell_size, bulk_modulus)
        return Scene.from_dict(data)

    def _change(
        self, data: dict[str, Any], new: Settings, cell_size: bool, bulk_modulus: bool
    ) -> None:
        data["method"] = plain(new.method)
        ratio = 1.0
        if cell_size and self.refine > 1:
            data["cell_size"] = new.cell_size
            ratio = 1.0 / self.refine
        for body in data["bodies"]:
            name = body["name"]
            if name in new.fbar:
                body["fbar"] = _scaled(new.fbar[name], ratio)
            if name in new.particles_per_cell:
                body["particles_per_cell"] = new.particles_per_cell[name]
            if bulk_modulus and name in new.bulk_modulus:
                body["material"]["bulk_modulus"] = new.bulk_modulus[name]
            own = body["transfer"]
            if own is not None and own["scheme"] != new.method.transfer_choice.scheme:
                body["transfer"] = None
        for boundary in data["boundaries"]:
            if boundary["name"] in new.mirrored:
                boundary["response"] = {"type": "Mirror", "slip": True}
            if boundary["name"] in new.linear:
                boundary["response"] = {"type": "Slip", "cell": "linear"}
            if new.layer is not None and boundary["name"] in self.surfaces:
                boundary["layer"] = plain(new.layer)

    @property
    def surfaces(self) -> tuple[str, ...]:
        """Names of the boundaries that are surfaces of any shape."""
        return tuple(b.name for b in self.scene.boundaries if b.is_surface)

    def _head(self) -> list[tuple[str, str]]:
        name = self.scene.name or "unnamed"
        rows = [("scene", f"{name}, asked for an error of {self.error:.3g} on {self.device}")]
        rows += [("like", f"{m.case}: {m.why}") for m in self.matches]
        if self.expected_error is None:
            return rows
        lines = ", ".join(f"{r.case} / {r.option} ({r.worst or 0.0:.1%})" for r in self.lines)
        rows.append(("expect", f"error {self.expected_error:.1%}{self._cells()}{self._missed()}"))
        rows.append(
            ("cost", f"{self.cost:.2g} times that of APIC without F-bar in the scene's own cells")
        )
        if self.present_error is not None:
            now = f"error {self.present_error:.1%}, cost {self.present_cost:.2g}"
            rows.append(("as it is", now))
        return [*rows, ("from", lines), ("atlas", self.source)]

    def _cells(self) -> str:
        if self.refine == 1 or self.settings is None:
            return ""
        return f", with cells of {self.settings.cell_size:.4g} m"

    def _missed(self) -> str:
        if self.reached:
            return ""
        return f": no measured setting is within {self.error:.3g}, and this is the nearest"

    def _settings(self) -> list[tuple[str, str, str]]:
        return [
            (r.setting, f"{r.value}{'' if r.changes else ' (as it is)'}", r.why)
            for r in self.reasons
        ]

    def __str__(self) -> str:
        """Return the advice as text for a terminal."""
        lines = [pair_table(self._head(), 9)]
        rows = self._settings()
        if rows:
            lines += ["", text_table(rows, flush="left")]
        if self.warnings:
            lines += ["", *(f"warning: {text}" for text in self.warnings)]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        """Return the advice as tables for Jupyter."""
        parts = [html_table(self._head())]
        if self.reasons:
            parts.append(html_table(self._settings(), ("setting", "value", "why")))
        return "".join(parts) + html_warnings(self.warnings)

    def __repr__(self) -> str:
        """Return a line with what changes."""
        if self.expected_error is None:
            return f"<Advice for {self.scene.name!r}: nothing to propose>"
        changed = [r.setting for r in self.reasons if r.changes]
        what = f"changes {', '.join(changed)}" if changed else "changes nothing"
        return (
            f"<Advice for {self.scene.name!r}: {what}; error {self.expected_error:.1%}, "
            f"cost {self.cost:.2g}, {len(self.warnings)} warnings>"
        )


def _scaled(fbar: FBar | None, ratio: float) -> Any:
    """Return F-bar in terms of JSON, its length and time with the size of the cells."""
    if fbar is None:
        return None
    found = plain(fbar)
    for name in ("length", "time"):
        if found[name] is not None:
            found[name] *= ratio
    return found
