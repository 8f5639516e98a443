"""Sensors: `LoadCell`, `WaveGauge`, `VelocityProbe`, `ParticleTracker`, `Energy`."""

from libmpm._src.sensors import (
    Energy,
    LoadCell,
    ParticleTracker,
    Sensor,
    VelocityProbe,
    WaveGauge,
)

__all__ = ["Energy", "LoadCell", "ParticleTracker", "Sensor", "VelocityProbe", "WaveGauge"]
