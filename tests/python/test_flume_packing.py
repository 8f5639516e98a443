"""What keeps the water of laboratory flumes from packing. Expected duration: 1 s."""

import pytest

import libmpm
from libmpm import flumes


def test_what_keeps_water_from_packing():
    """By default density in the basin, nothing in the long flume; either by name."""
    basin, flume = flumes.DirectionalWaveBasin, flumes.LargeWaveFlume
    assert basin(cell_size=0.3).scene().bodies[0].fbar == libmpm.FBar(density=True)
    assert basin(cell_size=0.3, packing=None).scene().bodies[0].fbar == "default"
    assert flume(cell_size=0.5).scene().bodies[0].fbar == "default"
    for packing in ("density", "shifting"):
        water = flume(cell_size=0.5, packing=packing).scene().bodies[0]
        assert water.fbar == libmpm.FBar(**{packing: True})
    with pytest.raises(libmpm.SceneError, match="packing is 'none'"):
        basin(packing="none")
