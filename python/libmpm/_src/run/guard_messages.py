"""What a guard says: who is the first offender, and what to do about it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from libmpm._src.boundaries.wall_cells import by_caution, strains_linearly
from libmpm._src.scene.places import faces_present

if TYPE_CHECKING:
    from libmpm._src.run.running import Running
    from libmpm._src.scene.parts import Body

__all__ = ["OFF", "Offender", "energy_remedy", "fastest", "fastest_within", "in_words", "missing"]
__all__ += ["moment", "most_strained", "smoothing_remedy"]

#: Ids shown in a message; the rest is counted.
_SHOWN = 8

OFF = "Simulation(guard=None) switches the run-time checks off"


@dataclass(frozen=True)
class Offender:
    """The particle in which something is largest."""

    body: str
    id: int
    position: tuple[float, ...]
    value: float

    def __str__(self) -> str:
        """Return body, particle and place."""
        place = ", ".join(f"{x:.6g}" for x in self.position)
        return f"body '{self.body}', particle {self.id} at ({place}) m"


def _of_all(simulation: Running, mine: Offender | None, around: float = 0) -> Offender | None:
    """Return that of all ranks that is furthest from `around`; all of them call this together."""
    link = simulation._shared.link
    found = [mine]
    if link is not None:
        told = link.tell(None if mine is None else [mine.body, mine.id, mine.position, mine.value])
        found = [None if x is None else Offender(x[0], x[1], tuple(x[2]), x[3]) for x in told]
    left = [x for x in found if x is not None]
    return max(left, key=lambda x: abs(x.value - around), default=None)


def _largest(simulation: Running, body: str, name: str, around: float = 0) -> Offender | None:
    view, mine = simulation.particles[body], None
    if len(view):
        read = view.read(["id", "position", name])
        k = int(np.argmax(np.abs(read[name] - around)))
        place = tuple(float(x) for x in read["position"][k])
        mine = Offender(body, int(read["id"][k]), place, float(read[name][k]))
    return _of_all(simulation, mine, around)


def fastest(simulation: Running, body: str | None = None) -> Offender | None:
    """Return the fastest particle of a body, or of all; ranks together, as all of these."""
    names = list(simulation.particles) if body is None else [body]
    found = [x for x in (_largest(simulation, n, "speed") for n in names) if x is not None]
    return max(found, key=lambda x: x.value, default=None)


def fastest_within(simulation: Running, body: str) -> Offender | None:
    """Return the particle that is fastest relative to its body's mean velocity."""
    view, link, mine = simulation.particles[body], simulation._shared.link, None
    read = view.read(["id", "position", "velocity"]) if len(view) else None
    if link is None:
        mean = None if read is None else read["velocity"].mean(axis=0)
    else:
        none = [0.0] * simulation.dimension
        told = link.tell(none if read is None else read["velocity"].sum(axis=0).tolist())
        mean = np.sum(told, axis=0) / max(1, link.add([len(view)])[0])
    if read is not None:
        relative = np.linalg.norm(read["velocity"] - mean, axis=1)
        k = int(np.argmax(relative))
        place = tuple(float(x) for x in read["position"][k])
        mine = Offender(body, int(read["id"][k]), place, float(relative[k]))
    return _of_all(simulation, mine)


def most_strained(simulation: Running, body: str) -> Offender | None:
    """Return the particle of a body whose volume ratio is furthest from 1."""
    return _largest(simulation, body, "volume_ratio", 1.0)


def in_words(offender: Offender | None, unit: str = "") -> str:
    """Return it with its value."""
    if offender is None:
        return "no particle is left"
    return f"{offender} with {offender.value:.4g} {unit}".rstrip()


def missing(simulation: Running, index: int) -> str:
    """Return the ids of a body that no particle has, of those up to the highest one left."""
    name = list(simulation.particles)[index]
    ids = simulation.particles[name]["id"].astype(np.int64)
    if simulation._shared.link is not None:
        everyone = simulation._shared.link.gather({"id": ids})
        if everyone is None:
            return "rank 0 knows their ids"
        ids = np.sort(everyone["id"])
    if not len(ids):
        return "none is left"
    doubled = ids[1:][np.diff(ids) == 0]
    gaps = np.setdiff1d(np.arange(ids[0], ids[-1] + 1), ids)
    parts = []
    for word, found in (("twice", doubled), ("without particle", gaps)):
        if len(found):
            shown = ", ".join(str(int(i)) for i in found[:_SHOWN])
            more = f" and {len(found) - _SHOWN} more" if len(found) > _SHOWN else ""
            parts.append(f"ids {word}: {shown}{more}")
    return "; ".join(parts) or f"ids {ids[0]} to {ids[-1]} are whole"


def moment(simulation: Running) -> str:
    """Return step, time and time step."""
    return f"at step {simulation.steps}, {simulation.time:.6g} s (time step {simulation.dt:.4g} s)"


def energy_remedy(simulation: Running) -> str:
    """Return what makes energy grow in a scene of this method, as a remedy."""
    scene, ways = simulation.scene, []
    if scene.grid is not None:
        ways.append(
            "use quadratic Powell-Sabin or spline functions, which have no jumps of the gradient, "
            "grids.PartialMass() or more particles per cell"
        )
    else:
        kernel = scene.method.kernel_choice
        if "linear" in kernel.text():
            ways.append("use a quadratic kernel: linear functions jump where a particle crosses")
        if scene.transfer.scheme in ("FMPM", "XPIC"):
            ways.append(f"use a lower order of {scene.transfer.scheme}, or it every few steps only")
        elif scene.transfer.scheme not in ("APIC", "PIC"):
            ways.append("use transfer 'APIC', which damps more")
        linear = (
            b.name
            for b in scene.boundaries
            for face in (faces_present(scene, b) or ("",))
            if strains_linearly(scene, b, face) and not by_caution(b, face)
        )
        if scene.contacts and (floor := next(linear, None)):
            ways.append(
                f"where bodies lie in piles on '{floor}', cell=\"held\" for it: on linear cells "
                "the lowest were sheared without end"
            )
    ways.append("lower Method.cfl or the time step")
    if simulation.precision == "single":
        ways.append("precision='double'")
    return f"{'; '.join(ways)}; where the growth is meant, Guard(energy=...) or {OFF}"


def smoothing_remedy(body: Body) -> str:
    """Return what takes less from a body than its smoothing over cells, as a remedy."""
    assert body.smoothing is not None
    method, ways = body.smoothing.method, []
    if method in ("F0", "NB"):
        ways.append("a limiter, Smoothing(method='F0AL1')")
    if method not in ("C0", "C1"):
        ways.append("'C0', which moves nothing between cells")
    ways.append("more cells in the body")
    if body.material.table.stores_volume:
        ways += ["more particles per cell", "FBar() instead of smoothing"]
    return "; ".join(ways)
