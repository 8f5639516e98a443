"""
Compiled core of libmpm: CPU backend (OpenMP).
"""
from __future__ import annotations
import collections.abc
import numpy
import numpy.typing
import typing
import typing_extensions
__all__: list[str] = ['Basis', 'Column', 'Engine', 'Processes', 'add_material', 'build_info', 'equation_of_state', 'material_table', 'plan', 'smooth_points']
class Column:
    """
    Numbers one after another in the memory of an engine's device.
    """
    def dlpack(self, versioned: bool, copied: bool) -> typing_extensions.CapsuleType:
        ...
    def numpy(self) -> numpy.ndarray[typing.Any, numpy.dtype[typing.Any]]:
        ...
    @property
    def device(self) -> int:
        ...
    @property
    def pointer(self) -> int:
        ...
    @property
    def shape(self) -> tuple:
        ...
    @property
    def type(self) -> str:
        ...
class Engine:
    """
    A simulation on one device, built from a spec (design/engine-contract.md).
    """
    def __init__(self, spec: dict) -> None:
        ...
    def assign(self, body: typing.SupportsInt | typing.SupportsIndex, ids: typing.Annotated[numpy.typing.ArrayLike, numpy.uint64], change: typing.Annotated[numpy.typing.ArrayLike, numpy.float64], state: typing.Annotated[numpy.typing.ArrayLike, numpy.float64], pressure: typing.Annotated[numpy.typing.ArrayLike, numpy.float64]) -> None:
        ...
    def attribute(self, body: typing.SupportsInt | typing.SupportsIndex, name: str) -> typing.Any:
        ...
    def attribute_names(self, body: typing.SupportsInt | typing.SupportsIndex) -> list[str]:
        ...
    def attributes(self, body: typing.SupportsInt | typing.SupportsIndex, names: collections.abc.Sequence[str], within: collections.abc.Sequence[tuple[collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex], collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex]]] = []) -> dict:
        ...
    def condition(self, samples: typing.SupportsInt | typing.SupportsIndex) -> dict:
        ...
    def drain(self) -> list:
        ...
    def flows(self) -> list:
        ...
    def gather(self, body: typing.SupportsInt | typing.SupportsIndex, names: collections.abc.Sequence[str], origin: collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex]) -> dict:
        ...
    def grid(self, name: str, within: collections.abc.Sequence[tuple[collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex], collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex]]] = []) -> numpy.ndarray[typing.Any, numpy.dtype[typing.Any]]:
        ...
    def load(self, state: dict) -> None:
        ...
    def particle_count(self, body: typing.SupportsInt | typing.SupportsIndex) -> int:
        ...
    def removed(self) -> list:
        ...
    def run(self, steps: typing.SupportsInt | typing.SupportsIndex, until: typing.SupportsFloat | typing.SupportsIndex, wall: typing.SupportsFloat | typing.SupportsIndex) -> dict:
        ...
    def save(self) -> dict:
        ...
    def sensor_columns(self, sensor: typing.SupportsInt | typing.SupportsIndex) -> tuple[list[str], list[str]]:
        ...
    def smoothing(self, body: typing.SupportsInt | typing.SupportsIndex) -> numpy.typing.NDArray[numpy.float64]:
        """
        Rows (time, calls, energy before, its change, I_E) of smoothing over cells.
        """
    def statistics(self) -> dict[str, float]:
        ...
    def sums(self, within: collections.abc.Sequence[tuple[collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex], collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex]]] = []) -> dict:
        ...
    def timings(self) -> dict[str, float]:
        ...
    @property
    def generation(self) -> int:
        ...
    @property
    def step(self) -> int:
        ...
    @property
    def time(self) -> float:
        ...
    @property
    def time_step(self) -> float:
        ...
class Processes:
    """
    This process among those of its job (design/ranks.md).
    """
    def __init__(self, seconds: typing.SupportsFloat | typing.SupportsIndex) -> None:
        ...
    def stop(self, why: str) -> None:
        ...
    def tell_all(self, given: bytes) -> list:
        """
        What all gave, by rank.
        """
    def tell_first(self, given: bytes) -> typing.Any:
        """
        What all gave, by rank, on rank 0; None on the others.
        """
    @property
    def launcher(self) -> str:
        ...
    @property
    def local_rank(self) -> int:
        ...
    @property
    def local_ranks(self) -> int:
        ...
    @property
    def rank(self) -> int:
        ...
    @property
    def ranks(self) -> int:
        ...
class Basis:
    """
    The functions of a grid over cells.
    """
    def __init__(self, grid: dict) -> None:
        """
        From the "grid" of a spec (design/engine-contract.md).
        """
    def control_points(self) -> numpy.typing.NDArray[numpy.float64]:
        """
        Points (functions, 2) whose sum with the functions is the position.
        """
    def control_triangles(self) -> typing.Any:
        """
        Corners (v, 3, 2) of the control triangles of the vertices, or None.
        """
    def evaluate(self, points: typing.Annotated[numpy.typing.ArrayLike, numpy.float64]) -> tuple:
        """
        Numbers (n, k), values (n, k) and gradients (n, k, 2) of the functions at points (n, 2); a row is filled up with function -1 and zeros.
        """
    def locate(self, points: typing.Annotated[numpy.typing.ArrayLike, numpy.float64]) -> numpy.typing.NDArray[numpy.int32]:
        """
        Cells (n,) of points (n, 2), -1 outside.
        """
    def outline(self) -> numpy.typing.NDArray[numpy.float64]:
        """
        Start and end (k, 2, 2) of the pieces of the outline.
        """
    def quadrature(self, points_per_direction: typing.SupportsInt | typing.SupportsIndex) -> tuple:
        """
        Points (q, 2) and weights (q,), exact on every piece to degree 2 points_per_direction - 2.
        """
    def split(self) -> typing.Any:
        """
        Inner points (t, 2) and points on the sides (t, 3, 2) of the triangles, or None.
        """
    @property
    def cells(self) -> int:
        ...
    @property
    def degree(self) -> int:
        ...
    @property
    def functions(self) -> int:
        ...
    @property
    def name(self) -> str:
        ...
def add_material(path: str) -> str:
    """
    Loads the library of a material that was compiled for itself; returns its name.
    """
def build_info() -> dict:
    """
    How this library was built and what it will use.
    """
@typing.overload
def equation_of_state(j: numpy.typing.NDArray[numpy.float32], bulk_modulus: typing.SupportsFloat | typing.SupportsIndex, exponent: typing.SupportsFloat | typing.SupportsIndex) -> numpy.typing.NDArray[numpy.float32]:
    """
    Pressure [Pa] of TaitFluid for volume losses j = 1 - J, in the precision of j.
    """
@typing.overload
def equation_of_state(j: numpy.typing.NDArray[numpy.float64], bulk_modulus: typing.SupportsFloat | typing.SupportsIndex, exponent: typing.SupportsFloat | typing.SupportsIndex) -> numpy.typing.NDArray[numpy.float64]:
    ...
def material_table() -> list:
    """
    Descriptions of all materials and their parameters.
    """
def plan(spec: dict, kind: str) -> dict:
    """
    What a spec costs on a "cpu" or on a "cuda" device that need not exist, before anything is allocated (design/engine-contract.md).
    """
def smooth_points(field: typing.Annotated[numpy.typing.ArrayLike, numpy.float64], mass: typing.Annotated[numpy.typing.ArrayLike, numpy.float64], position: typing.Annotated[numpy.typing.ArrayLike, numpy.float64], cell_size: typing.SupportsFloat | typing.SupportsIndex, choice: dict, passes: typing.SupportsInt | typing.SupportsIndex) -> tuple:
    """
    A field (n, components) on points, smoothed over cells, and energies of each pass.
    """
