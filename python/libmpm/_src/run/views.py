"""`sim.particles`, `sim.grid`, `sim.sensors`: reading a running simulation without changing it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from libmpm._src.base.arguments import known, nearest, quoted
from libmpm._src.base.tables import html_table
from libmpm._src.base.values import Checker
from libmpm._src.output.series import Series
from libmpm._src.sensors import attributes

if TYPE_CHECKING:
    from libmpm._src.run.running import Running

__all__ = ["BodyView", "GridView", "ParticlesView", "SensorsView", "world_shift"]


_BODIES = ("body", "material")


class BodyView(Mapping[str, NDArray[Any]]):
    """The particles of one body: ``view["position"]`` is a NumPy copy, rows sorted by id.

    Besides `names` it takes the library names of attributes, such as ``view["VonMisesStress"]``.

    Scalars are (n,), vectors (n, dimension), tensors (n, dimension, dimension), float64 in SI
    units; ``id`` is uint64 and ``position`` is in world coordinates, m. Of a body of elements rows
    are its vertices; ``element_stress`` (m, dimension, dimension), ``element_pressure``,
    ``element_von_mises``, principal stresses ``element_stress_1`` to ``_3``, components
    ``element_stress_XX``, ..., ``element_volume_ratio``, ``element_energy`` and, of laws that
    flow, ``element_plastic_strain`` (m,) have one for each element, in the mesh's order. Of ranks
    that are processes one has an element; on the others its row is not a number
    (`Simulation.gather`).
    """

    def __init__(self, simulation: Running, index: int, name: str) -> None:
        """Make the view of body number `index`."""
        self._simulation = simulation
        self._index = index
        self.name = name

    @property
    def names(self) -> list[str]:
        """Every attribute that is stored or can be derived."""
        return list(self._simulation.engine.attribute_names(self._index))

    def __len__(self) -> int:
        """Return the number of particles, fewer than at the start if some were deleted."""
        return self._simulation.particle_count(self._index)

    def __iter__(self) -> Iterator[str]:
        """Iterate over the attribute names."""
        return iter(self.names)

    def __contains__(self, name: object) -> bool:
        """Tell whether the attribute exists."""
        return known(name, self.names)

    def read(self, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Return several attributes, gathered in one pass over the particles."""
        scene, stored = self._simulation.scene, self.names
        body = scene.bodies[self._index]
        wanted = ["id"]
        check = Checker(f"body '{self.name}'")
        names = check.items("names", None if isinstance(names, str) else names, "a list of names")
        check.finish()
        for name in names:
            problem = self.refusal(name)
            if problem is not None:
                raise KeyError(f"body '{self.name}' has no attribute {quoted(name)}; {problem}")
            wanted += [name] if name in stored else attributes.reads(name, body, stored)
        arrays = self._simulation.engine.attributes(self._index, list(dict.fromkeys(wanted)))
        order = np.argsort(arrays["id"], kind="stable")
        # Elements keep the order of the mesh, vertices their numbers.
        read = {
            name: np.asarray(array) if attributes.of_elements(name) else np.asarray(array)[order]
            for name, array in arrays.items()
        }
        if "position" in read:
            read["position"] = read["position"] + self._simulation.offset
        source = attributes.Source(read, body, attributes.upward(scene))
        return {n: read[n] if n in stored else attributes.compute(n, source) for n in names}

    def refusal(self, name: str) -> str | None:
        """Return why an attribute cannot be read from this body, with the remedy; None if it can.

        Besides `names` all library names ("StressCauchy_XX", "VonMisesStress", ...) can.
        """
        if known(name, self.names):
            return None
        scene = self._simulation.scene
        if attributes.find(name) is None:
            return nearest(name, [*self.names, *attributes.names()])
        return attributes.refusal(name, scene.bodies[self._index], scene)

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return one attribute."""
        return self.read([name])[name]

    def __setitem__(self, name: str, array: Any) -> None:
        """Set the "velocity" (n, dimension) m/s or "pressure" (n,) Pa of every particle.

        Affine transfers (APIC, AFLIP, ASFLIP) take "velocity_gradient" (n, dimension, dimension)
        too, 1/s, [:, c, a] = ∂v_c/∂x_a; without it a turn about itself starts slower than the
        velocities say, by about Δx²/R² of its rate. A `Field` brings its own.

        Before the first step only. `array` is of NumPy, or of any library with DLPack or a CUDA
        array interface, rows in the order of ``id``. The scene file does not hold it: a run with
        output keeps it in ``initial.npz``. Raises `SceneError`.
        """
        self._simulation.set_initial(self.name, name, array)

    def __repr__(self) -> str:
        """Return body, count and time."""
        return f"<body '{self.name}': {len(self)} particles at {self._simulation.time:g} s>"

    def _repr_html_(self) -> str:
        """Return shape and material as a table for Jupyter, without asking the device."""
        body = self._simulation.scene.bodies[self._index]
        return html_table(
            [("particles of", self.name), ("shape", body.shape), ("material", body.material)]
        )


class ParticlesView(Mapping[str, BodyView]):
    """Body name -> particles."""

    def __init__(self, simulation: Running) -> None:
        """Make a view of every body of the scene."""
        self._simulation = simulation
        names = [body.name for body in simulation.scene.bodies]
        self._views = {name: BodyView(simulation, i, name) for i, name in enumerate(names)}

    def __getitem__(self, body: str) -> BodyView:
        """Return the particles of one body."""
        if not known(body, self._views):
            raise KeyError(f"no body {quoted(body)}; {nearest(body, self._views)}")
        return self._views[body]

    def __iter__(self) -> Iterator[str]:
        """Iterate over the body names in the scene's order."""
        return iter(self._views)

    def __len__(self) -> int:
        """Return the number of bodies."""
        return len(self._views)

    def __repr__(self) -> str:
        """Return the bodies, without asking the device."""
        return f"<particles of {', '.join(self._views) or 'no body'}>"

    def _repr_html_(self) -> str:
        """Return bodies and materials as a table for Jupyter, without asking the device."""
        bodies = self._simulation.scene.bodies
        return html_table([(b.name, type(b.material).__name__) for b in bodies], _BODIES)


class GridView(Mapping[str, NDArray[np.float64]]):
    """Active nodes of the grid: ``position`` (n, d) m in the world, ``velocity`` m/s, ``mass`` kg.

    Nodes are cell centres. The velocity is the one with which the coming step moves particles.
    """

    names = ("position", "velocity", "mass")

    def __init__(self, simulation: Running) -> None:
        """Make the view."""
        self._simulation = simulation

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        """Return one array over the active nodes."""
        if not known(name, self.names):
            raise KeyError(f"the grid has no {quoted(name)}; {nearest(name, self.names)}")
        values = np.asarray(self._simulation.engine.grid(name))
        return values + self._simulation.offset if name == "position" else values

    def __iter__(self) -> Iterator[str]:
        """Iterate over the array names."""
        return iter(self.names)

    def __len__(self) -> int:
        """Return the number of arrays."""
        return len(self.names)

    def __repr__(self) -> str:
        """Return the names of the arrays, without asking the device."""
        return f"<active nodes of the grid: {', '.join(self.names)}>"

    def _repr_html_(self) -> str:
        """Return the names of the arrays as a table for Jupyter, without asking the device."""
        return html_table([("active nodes of the grid", ", ".join(self.names))])


class SensorsView(Mapping[str, Series]):
    """Sensor name -> series with `time`, `values`, `components` and `units`."""

    def __init__(self, simulation: Running) -> None:
        """Make the view; the series themselves appear with the engine."""
        self._simulation = simulation
        self._names = [placed.name for placed in simulation.scene.sensors]

    def all_series(self) -> list[Series]:
        """Return the series in the scene's order, then those of inflows and outflows."""
        return [*self._simulation.series(), *self._simulation.flow_series()]

    def __getitem__(self, sensor: str) -> Series:
        """Return the series of one sensor."""
        if sensor not in self._names:
            raise KeyError(f"no sensor '{sensor}'; {nearest(sensor, self._names)}")
        return self.all_series()[self._names.index(sensor)]

    def __iter__(self) -> Iterator[str]:
        """Iterate over the sensor names in the scene's order."""
        return iter(self._names)

    def __len__(self) -> int:
        """Return the number of sensors."""
        return len(self._names)

    def __repr__(self) -> str:
        """Return the names of the sensors, without asking for samples."""
        return f"<series of {', '.join(self._names) or 'no sensor'}>"

    def _repr_html_(self) -> str:
        """Return names and kinds as a table for Jupyter; samples are not asked for."""
        from libmpm._src.output.html import series_list_html

        kinds = [type(placed.sensor).__name__ for placed in self._simulation.scene.sensors]
        return series_list_html(self._names, kinds)


def world_shift(
    description: dict[str, Any], components: list[str], offset: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return what turns coordinates relative to the lower corner into world ones, (k,) m."""
    shift = np.zeros(len(components))
    if description["kind"] == "wave-gauge":
        shift[:] = offset[description["axis"]]
    elif description["kind"] in ("tracker", "rigid-motion"):
        axes = "xyz"[: len(offset)]
        for i, name in enumerate(components):
            # Columns are called position_x:17 for particle 17.
            quantity, _, axis = name.partition(":")[0].rpartition("_")
            if quantity in ("position", "centroid"):
                shift[i] = offset[axes.index(axis)]
    return shift
