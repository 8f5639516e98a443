"""Sensors.

Evaluated by the engine, at hardly any cost: `LoadCell`, `ContactLoad`, `WaveGauge`,
`VelocityProbe`, `ParticleTracker`, `RigidMotion`, `PinForce`, `Energy`. Evaluated in Python at
their due times: `GridSensor`, `ParticleSensor`, `AttributeTracker`, `BodyTracker`, `ContactForce`,
`PressureProbe`, `ElevationGauge`, `ColumnGauge`, `Custom`.
"""

from libmpm._src.sensors.attributes import names as attribute_names
from libmpm._src.sensors.column_gauge import ColumnGauge
from libmpm._src.sensors.engine_sensors import (
    ContactLoad,
    Energy,
    LoadCell,
    ParticleTracker,
    PinForce,
    RigidMotion,
    Sensor,
    VelocityProbe,
    WaveGauge,
)
from libmpm._src.sensors.python_sensors import (
    AttributeTracker,
    BodyTracker,
    ContactForce,
    Custom,
    ElevationGauge,
    GridSensor,
    ParticleSensor,
    PressureProbe,
)

__all__ = ["AttributeTracker", "BodyTracker", "ColumnGauge", "ContactForce", "ContactLoad"]
__all__ += ["Custom", "ElevationGauge", "Energy", "GridSensor"]
__all__ += [
    "LoadCell",
    "ParticleSensor",
    "ParticleTracker",
    "PinForce",
    "PressureProbe",
    "RigidMotion",
    "Sensor",
]
__all__ += ["VelocityProbe", "WaveGauge", "attribute_names"]
