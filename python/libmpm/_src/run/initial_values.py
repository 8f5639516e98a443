"""`sim.particles[...] = array` before the first step: states given particle by particle.

They are taken before the first step only. Afterwards the state is particles and nodal sums that
already hold the particles' momentum and stress: a column changed on its own would contradict them.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from libmpm._src.base.arguments import known, nearest, quoted
from libmpm._src.base.arrays import real_array
from libmpm._src.errors import SceneError
from libmpm._src.output.atomic_files import replacing

if TYPE_CHECKING:
    from libmpm._src.run.running import Running

__all__ = ["Initial"]

#: What may be given, with its unit and what it is for.
_TAKEN = {"velocity": "m/s", "velocity_gradient": "1/s", "pressure": "Pa"}


class Initial:
    """The arrays given for the bodies of one simulation."""

    def __init__(self) -> None:
        """Begin with none."""
        self._given: dict[str, dict[str, NDArray[np.float64]]] = {}

    def __bool__(self) -> bool:
        """Tell whether anything was given."""
        return bool(self._given)

    def take(self, simulation: Running, body: str, name: str, array: Any) -> None:
        """Keep a copy of an array for one body; raises `SceneError`."""
        label = f"particles of body {quoted(body)}"
        names = [b.name for b in simulation.scene.bodies]
        if not known(body, names):
            raise SceneError(f"{label}: there is no such body; {nearest(body, names)}")
        if not known(name, _TAKEN):
            why = "; positions and the material's state follow from shapes and materials"
            why = why if known(name, simulation.particles[body].names) else ""
            raise SceneError(f"{label}: {quoted(name)} cannot be set; {nearest(name, _TAKEN)}{why}")
        scene = simulation.scene
        index = [b.name for b in scene.bodies].index(body)
        if simulation.steps > 0 or scene.start is not None:
            raise SceneError(
                f"{label}: {name} is set at step {simulation.steps} of a scene "
                f"that {'has run' if scene.start is None else 'continues from a checkpoint'}"
                "; expected a simulation before its first step: afterwards the grid holds the "
                "particles' momentum and stress already; make a new Simulation"
            )
        material = scene.bodies[index].material
        if name == "pressure" and not material.table.stores_volume:
            raise SceneError(
                f"{label}: pressure is set, but {type(material).__name__} stores no volume ratio "
                "to set it by; expected a fluid"
            )
        transfer = scene.bodies[index].transfer or scene.transfer
        if name == "velocity_gradient" and (scene.grid is not None or not transfer.affine):
            how = "functions over cells" if scene.grid is not None else f"'{transfer.scheme}'"
            raise SceneError(
                f"{label}: velocity_gradient is set, but {how} deposits no gradient of velocities; "
                "expected an affine transfer (APIC, AFLIP or ASFLIP); leave it out"
            )
        try:
            values = np.array(real_array(array, f"{label}: {name}"), order="C")
        except (OverflowError, TypeError, ValueError) as error:
            raise SceneError(
                f"{label}: {name} is no array of numbers: {error}; expected real numbers in "
                f"{_TAKEN[name]}"
            ) from error
        count = simulation.particle_count(index)
        rank = {"velocity": 1, "velocity_gradient": 2}.get(name, 0)
        shape = (count, *(scene.dimension,) * rank)
        if values.shape != shape:
            raise SceneError(
                f"{label}: {name} has the shape {values.shape}; expected {shape}, a row a particle "
                f"in the order of sim.particles['{body}']['id'], in {_TAKEN[name]}"
            )
        finite = np.isfinite(values)
        if not finite.all():
            row = int(np.argwhere(~finite)[0][0])
            raise SceneError(f"{label}: {name}[{row}] is {values[row]}; expected finite numbers")
        self._given.setdefault(body, {})[name] = values

    def into(self, specification: dict[str, Any]) -> None:
        """Put what was given into an engine's specification."""
        for body in specification["bodies"]:
            given = self._given.get(body["name"], {})
            if "velocity" in given:
                body.pop("velocity_gradient", None)  # of the scene's own field
            for name, values in given.items():
                if name.startswith("velocity"):
                    body[name] = values
                else:
                    body[name] = lambda first, last, values=values: values[first:last]

    def save(self, path: Path) -> None:
        """Write everything given to a NumPy archive, ``<body>/<name>``; the scene file lacks it."""
        arrays: Any = {f"{b}/{n}": a for b, given in self._given.items() for n, a in given.items()}
        with replacing(path) as part, part.open("wb") as file:
            np.savez(file, **arrays)
