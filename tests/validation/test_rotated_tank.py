"""A tank of water at 45 degrees to the grid, its walls held by decay layers (Yang 2016, 5.1, V6).

T5 of the digest: whatever the layer but "free" keeps water in, R_b of (5.2) comes to 1, F0AL1 sinks
less than means at nodes do, and more particles lower the error of R_b. Expected duration: 15 s.
"""

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, materials, sensors, shapes
from libmpm.analysis import Signal

pytestmark = pytest.mark.validation

WIDTH = 3.2  # m, and depth
SIZE = WIDTH / 8
ALONG = np.array([1.0, -1.0]) / np.sqrt(2)  # the floor, in the grid's axes
UP = np.array([1.0, 1.0]) / np.sqrt(2)
SOFT = 2.2e7  # Pa: a tenth of the steps, ρ g H / K = 0.15 %


class Tank:
    """Eight spans of water along each axis, `per` x `per` particles a span, as in the source."""

    def __init__(self, folder, method, per=3, function="quadratic", modulus=2.2e9, samples=0.5e-3):
        n = 8 * per
        at = (np.arange(n) + 0.5) * WIDTH / n
        x, y = (c.ravel()[:, None] for c in np.meshgrid(at, at))
        file = folder / f"water{per}.npy"
        np.save(file, x * ALONG + y * UP)
        # Nodes are the centres of cells: the tank's lower left corner is one.
        low, high = np.array([-6.5, -11.5]) * SIZE, np.array([17.5, 15.5]) * SIZE
        scene = libmpm.Scene(
            dimension=2, cell_size=SIZE, lower=tuple(low), upper=tuple(high),
            gravity=tuple(-10 * UP),
            method=libmpm.Method(
                transfer="FLIP", kernel=libmpm.methods.Kernel(name="linear", modified=True),
                time_step=0.1 * SIZE / np.sqrt(modulus / 1000),
            ),
        )  # fmt: skip
        scene.add_body(
            name="water",
            shape=shapes.PointFile(file=str(file), particle_volume=(WIDTH / n) ** 2),
            material=materials.TaitFluid(density=1000, bulk_modulus=modulus, viscosity=1e-3),
            hydrostatic=WIDTH,
            smoothing=libmpm.methods.Smoothing(method=method),
            assumed=libmpm.methods.AssumedFields(over="node" if method == "NB" else "cell"),
        )
        walls = {"floor": ((0, 0), UP), "left": ((0, 0), ALONG), "right": (WIDTH * ALONG, -ALONG)}
        for name, (point, normal) in walls.items():
            scene.add_boundary(
                name=name, shape=shapes.HalfSpace(point=tuple(point), normal=tuple(normal)),
                response=boundaries.Separable(), layer=boundaries.DecayLayer(function=function),
            )  # fmt: skip
        scene.add_sensor(name="load", sensor=sensors.LoadCell(boundary="floor", interval=samples))
        self.sim = libmpm.Simulation(scene, device="cpu", precision="double", threads=1)

    def run(self, until, looks=10):
        """Most particles outside at a time, and h_eq of (5.1) at the end."""
        outside = 0
        for time in np.linspace(0, until, looks + 1)[1:]:
            self.sim.run(until=float(time), progress=False)
            place = self.sim.particles["water"]["position"]
            x, y = place @ ALONG, place @ UP
            outside = max(outside, int(((x < 0) | (x > WIDTH) | (y < 0)).sum()))
        return outside, 2 * y.mean()

    def ratio(self):
        """R_b of (5.2)."""
        series = self.sim.sensors["load"]
        force = -series.values[:, :2] @ UP
        return Signal(time=series.time, value=force, sampling="mean").normalised(1e4 * WIDTH**2)


FUNCTIONS = ("constrained", "flipped", "linear", "cosine", "quadratic")


def check_layers(folder, per, until, modulus):
    for function in FUNCTIONS:
        assert Tank(folder, "F0AL1", per, function, modulus).run(until)[0] == 0, function
    assert Tank(folder, "F0AL1", per, "free", modulus).run(until)[0] > 10


def check_ratio(folder, until):
    """Within 5 % from 0.05 s on, on a moving mean of 11 samples 0.5 ms apart."""
    tank = Tank(folder, "F0AL1", per=6)
    outside, depth = tank.run(until)
    mean = tank.ratio().resampled(0.5e-3).moving_mean(11, trim=1)
    assert abs(mean.value[mean.time > 0.05] - 1).max() < 0.05
    assert outside == 0
    return depth


def check_particles(folder, until, modulus):
    found = []
    for per in (3, 6, 12):
        tank = Tank(folder, "F0AL1", per, modulus=modulus)
        tank.run(until, looks=1)
        found.append(tank.ratio().resampled(0.5e-3).l2_error(1.0))
    assert found[0] > found[1] > found[2], found


def check_depth(folder, until, modulus, per=3):
    """F0AL1 loses less of the depth than means at nodes."""
    lost = [WIDTH - Tank(folder, m, per, modulus=modulus).run(until)[1] for m in ("F0AL1", "NB")]
    assert 0 < lost[0] < 0.5 * lost[1], lost


def test_layers_keep_water_in(tmp_path):
    check_layers(tmp_path, 3, 0.3, SOFT)


def test_reaction_comes_to_the_weight(tmp_path):
    assert check_ratio(tmp_path, 0.1) == pytest.approx(WIDTH, rel=1e-3)


def test_more_particles_lower_the_error_of_the_reaction(tmp_path):
    check_particles(tmp_path, 0.2, SOFT)


def test_means_at_nodes_sink_more(tmp_path):
    check_depth(tmp_path, 0.3, SOFT)


def test_as_long_as_the_source(tmp_path, full):
    """Layers and depths for 3 s, R_b and particles for the 0.3 s that waves need to die."""
    check_layers(tmp_path, 3, 3.0, 2.2e9)
    check_depth(tmp_path, 3.0, 2.2e9)
    check_ratio(tmp_path, 0.3)
    check_particles(tmp_path, 0.3, 2.2e9)
