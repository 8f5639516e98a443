"""Laboratory flumes as values: scene, instruments, and what was measured there.

`LargeWaveFlume`, `DirectionalWaveBasin`, `WasedaBasin`, `DebrisFlowFlume` and `WASIRF` give a
`Scene` from cell size, level, wave or drive, structure and debris, in a slice, one half or the full
width, with instruments under their laboratory names:

>>> from libmpm import flumes
>>> flume = flumes.LargeWaveFlume(cell_size=0.1)
>>> [one.name for one in flume.instruments()][:3]
['WG1', 'WG2', 'WG3']
>>> sim = libmpm.Simulation(flume.scene())  # doctest: +SKIP
>>> sim.run(until=flume.until)  # doctest: +SKIP
>>> print(flume.compare(sim))  # doctest: +SKIP

Each has `cases`, the set-ups that were measured (`of_case`); the first two have a `near_field` of
structure and debris, cut out of the run of a strip (`FacilityOfStrips`). `collect` gives all rows
of all of them in one table with the numbers of the runs in folders. `friction` and `FRICTION` are
documented values of debris on beds, `add_bed_friction` puts them on solids alone, `bevelled` cuts
the edges of a box.

`records` has the measured curves: `records.names()`, `records.load("lwf-waves")`. `named` returns a
facility by its name on the command line, `libmpm flume lwf --level laptop -o out`.
`stroke_of_gauge` makes a piston of a measured gauge.
"""

from __future__ import annotations

from libmpm._src.base.arguments import keywords_only
from libmpm._src.base.values import nearest, shown
from libmpm._src.errors import SceneError
from libmpm._src.flumes import records
from libmpm._src.flumes.collection import Collection, collect
from libmpm._src.flumes.comparison import Comparison, Row, blank, median_of
from libmpm._src.flumes.criteria import Criterion, Signals
from libmpm._src.flumes.debris_flow_flume import DebrisFlowFlume
from libmpm._src.flumes.directional_wave_basin import DirectionalWaveBasin
from libmpm._src.flumes.facility import Deviation, Facility, Instrument
from libmpm._src.flumes.large_wave_flume import LargeWaveFlume
from libmpm._src.flumes.near_field import FacilityOfStrips
from libmpm._src.flumes.structures import FRICTION, add_bed_friction, bevelled, friction
from libmpm._src.flumes.virtual_paddle import piston_of_flow, stroke_of_gauge
from libmpm._src.flumes.waseda_basin import WasedaBasin
from libmpm._src.flumes.wasirf import WASIRF

__all__ = [
    "FRICTION",
    "WASIRF",
    "Collection",
    "Comparison",
    "Criterion",
    "DebrisFlowFlume",
    "Deviation",
    "DirectionalWaveBasin",
    "Facility",
    "FacilityOfStrips",
    "Instrument",
    "LargeWaveFlume",
    "Row",
    "Signals",
    "WasedaBasin",
    "add_bed_friction",
    "bevelled",
    "blank",
    "collect",
    "friction",
    "median_of",
    "named",
    "names",
    "piston_of_flow",
    "records",
    "stroke_of_gauge",
]

_ALL: dict[str, type[Facility]] = {
    kind.short: kind
    for kind in (LargeWaveFlume, DirectionalWaveBasin, WasedaBasin, DebrisFlowFlume, WASIRF)
}


def names() -> list[str]:
    """Return the short names of all facilities."""
    return list(_ALL)


@keywords_only("flumes.named", 1, method=False)
def named(name: str) -> type[Facility]:
    """Return the class of a facility by its short name; raises `SceneError` with the nearest."""
    if name not in _ALL:
        raise SceneError(f"facility is {shown(name)}; {nearest(name, names())}")
    return _ALL[name]
