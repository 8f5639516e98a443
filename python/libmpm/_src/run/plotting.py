"""What a simulation shows: device arrays, pictures, tables; none of it has side effects."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from libmpm._src.base.values import keywords_only
from libmpm._src.output.html import simulation_html
from libmpm._src.run.device_arrays import DeviceArrays
from libmpm._src.run.running import Running
from libmpm._src.sensors.attributes import of_elements

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pyvista import Plotter

__all__ = ["SEAM", "Shown"]


#: What parts of libmpm need of a simulation (see `Running`), and no script does.
SEAM = (
    "engine", "first_step", "flow_series", "offset", "particle_count", "recorded_output",
    "recorded_until", "run_settings", "scene_document", "series", "set_initial", "set_output",
    "totals",
)  # fmt: skip


class Shown:
    """Pictures, tables and arrays of whatever is `Running`, by what anyone may see of it."""

    def __dir__(self) -> list[str]:
        """List the names that scripts use, for completion."""
        return sorted(set(super().__dir__()) - set(SEAM))

    @keywords_only("Simulation.device_arrays", 1)
    def device_arrays(self: Running, body: str, *fields: str) -> DeviceArrays:
        """Return the particles of a body as arrays on the device, for use in a ``with`` block.

        ``with sim.device_arrays("water") as a: x = cupy.from_dlpack(a.position)``.
        `fields` are gathered at once, others when asked for. See `DeviceArrays`; raises `KeyError`
        for unknown names, and `Error` where an array is used after the simulation has moved on.
        """
        return DeviceArrays(self, body, fields)

    @keywords_only("Simulation.gather", 1)
    def gather(self: Running, body: str, *names: str) -> dict[str, NDArray[Any]] | None:
        """Return attributes of all particles of a body on rank 0, in the order of ids.

        Ranks that are processes call this together; the others get None. "id" comes along. On one
        process it is ``sim.particles[body].read([...])``, sorted.
        """
        shared = self._shared
        with self.paused(), shared.together():
            read = dict(self.particles[body].read(["id", *names]))
            rows = [name for name in read if of_elements(name)]
            found = read if shared.link is None else shared.link.gather(read, rows)
        if found is None:
            return None
        order = np.argsort(found["id"])
        return {
            name: np.asarray(array) if of_elements(name) else np.asarray(array)[order]
            for name, array in found.items()
        }

    @keywords_only("Simulation.plot", 1, renamed={"color": "colour"})
    def plot(
        self: Running,
        colour: str | None = "speed",
        *,
        bodies: Sequence[str] | str | None = None,
        planes: Sequence[str] | str | None = None,
        cut: Sequence[float] | None = None,
        limits: tuple[float, float] | None = None,
        most: int = 200_000,
        axes: Any = None,
    ) -> Figure:
        """Return a figure of the particles as they are now, coloured by an attribute.

        =========  ====  ===========  =========================================================
        parameter  unit  range        meaning
        =========  ====  ===========  =========================================================
        colour     -     a name       attribute such as "pressure", component such as
                                      "velocity_x" or "stress_xy", the length of a vector; None =
                                      the colours of the bodies, which those without the
                                      attribute have too. Beside a fluid the speed of solids is
                                      shown where `bodies` names them
        bodies     -     names        None = all
        planes     -     names        such as "xz", or "3d": lit, from above a corner; None = the
                                      elevation and, in 3D, the plan; there the elevation is cut
                                      through what carries the first load cell, else the middle
        cut        m     (3,)         in 3D: what lies within a cell of this point along the axis
                                      that a plane does not show; None = planes that are named
                                      are seen from outside
        limits     its   low < high   range of the colours; None = all but the outermost half
                                      percent at either end
        most       1     ≥ 1          particles drawn, always the same ones; the title says it
                                      where that is not all
        axes       -     matplotlib   to draw the first plane into; None = a figure of its own
        =========  ====  ===========  =========================================================

        Coordinates are those of the world. Raises `Error`.
        """
        from libmpm._src.pictures.plot import plot

        with self.paused():
            return plot(
                self, colour=colour, bodies=bodies, planes=planes, cut=cut,
                limits=limits, most=most, axes=axes,
            )  # fmt: skip

    @keywords_only("Simulation.view", 1, renamed={"color": "colour"})
    def view(
        self: Running,
        colour: str | None = "speed",
        *,
        bodies: Sequence[str] | str | None = None,
        limits: tuple[float, float] | None = None,
        most: int = 200_000,
        off_screen: bool | None = None,
    ) -> Plotter:
        """Return a pyvista plotter of a 3D simulation as it is now; ``.show()`` opens it.

        In a notebook ``.show(jupyter_backend="html")`` gives a view that can be turned, "static"
        a picture. Parameters as of `plot`; `off_screen` for pictures by ``.screenshot(file)``.
        `libmpm[viz]` brings pyvista. Raises `Error`.
        """
        from libmpm._src.pictures.view_3d import view

        with self.paused():
            return view(
                self, colour=colour, bodies=bodies, limits=limits, most=most,
                off_screen=off_screen,
            )  # fmt: skip

    def _repr_html_(self: Running) -> str:
        """Return where it stands as a table for Jupyter, without asking the device."""
        return simulation_html(self)
