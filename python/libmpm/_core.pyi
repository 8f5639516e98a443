"""
Compiled core of libmpm: CPU backend (OpenMP).
"""
from __future__ import annotations
import collections.abc
import numpy
import numpy.typing
import typing
__all__: list[str] = ['Engine', 'build_info', 'equation_of_state', 'material_table', 'plan']
class Engine:
    """
    A simulation on one device, built from a spec (design/engine-contract.md).
    """
    def __init__(self, spec: dict) -> None:
        ...
    def attribute(self, body: typing.SupportsInt | typing.SupportsIndex, name: str) -> typing.Any:
        ...
    def attribute_names(self, body: typing.SupportsInt | typing.SupportsIndex) -> list[str]:
        ...
    def attributes(self, body: typing.SupportsInt | typing.SupportsIndex, names: collections.abc.Sequence[str]) -> dict:
        ...
    def drain(self) -> list:
        ...
    def grid(self, name: str) -> numpy.ndarray[typing.Any, numpy.dtype[typing.Any]]:
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
    def statistics(self) -> dict[str, float]:
        ...
    def timings(self) -> dict[str, float]:
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
