"""A tank started in hydrostatic balance stays so: 40 cells deep, lattice fill, 1e5 steps.

Expected duration: 5 s a case (480 particles, 4.8e7 particle-steps).
"""

import numpy as np
import pytest

import libmpm
from libmpm import boundaries
from support import scenes
from support.tolerances import REST_EDGE_CELL, REST_PROFILE, REST_SPEED

pytestmark = pytest.mark.validation

LAYERS, DEPTH, WIDTH = 40, 1.0, 3


def profile(sim, layers=LAYERS, depth=DEPTH):
    """Mean error of the pressure in every layer of cells, parts of ρ g H."""
    body = sim.particles["water"].read(["position", "pressure"])
    height = body["position"][:, 1]
    scale = scenes.WATER * scenes.GRAVITY
    error = (body["pressure"] - scale * (depth - height)) / (scale * depth)
    row = np.clip((height / depth * layers).astype(int), 0, layers - 1)
    count = np.bincount(row, minlength=layers)
    return np.bincount(row, weights=error, minlength=layers) / np.maximum(count, 1)


def speed(sim):
    """Root mean square of the node speeds, parts of sqrt(g H)."""
    v = sim.grid["velocity"]
    return np.sqrt(np.mean(np.sum(v**2, axis=1)) / (scenes.GRAVITY * DEPTH))


#: Largest speed, parts of √(gH), beside walls of linear cells: the acceptance of their study, whose
#: profile (0.5 %) and bed (1 %) are within the bounds of the source.
LINEAR_SPEED = 2e-4


@pytest.mark.parametrize(
    ("precision", "cell", "most"),
    [
        ("double", "held", REST_SPEED),
        ("single", "held", REST_SPEED),
        ("single", "linear", LINEAR_SPEED),
    ],
)
def test_hundred_thousand_steps(precision, cell, most, device, figure):
    scene = scenes.tank(
        cells=(WIDTH, LAYERS), cell_size=DEPTH / LAYERS, modulus=scenes.stiffness(DEPTH),
        gravity=scenes.GRAVITY, at_rest=True, interval=1.0, response=boundaries.Slip(cell=cell),
    )  # fmt: skip
    sim = libmpm.Simulation(scene, device=device, precision=precision, threads=1)
    speeds = []
    for _ in range(400):
        sim.step(250)
        speeds.append(speed(sim))
    late = np.sqrt(np.mean(np.square(speeds[-40:])))
    error = profile(sim)
    rms = np.sqrt(np.mean(error**2))
    _, axes = figure.new(columns=2)
    axes[0].plot(error, (np.arange(LAYERS) + 0.5) / LAYERS)
    for side in (-1, 1):
        axes[0].axvline(side * REST_EDGE_CELL, color="r", label="bound of bed and surface cell")
    axes[0].set(xlabel="(p - ρg(H-y)) / ρgH", ylabel="y / H", title=f"rms {rms:.4f}")
    axes[1].semilogy(np.arange(1, 401) * 250, speeds)
    axes[1].axhline(most, color="r", label="bound")
    axes[1].set(xlabel="step", ylabel="rms node speed / √(gH)", title=f"last tenth {late:.1e}")
    assert rms <= REST_PROFILE
    assert abs(error[0]) <= REST_EDGE_CELL
    assert abs(error[-1]) <= REST_EDGE_CELL
    assert late <= most


def test_ten_kilometres_away(device):
    """Absolute coordinates 10 km from zero agree to 1e-5, the scene's origin to the bit."""

    def run(**place):
        scene = scenes.tank(
            cells=(4, 8), cell_size=0.1, modulus=scenes.stiffness(0.8), at_rest=True,
            gravity=scenes.GRAVITY, **place,
        )  # fmt: skip
        sim = libmpm.Simulation(scene, device=device, precision="double", threads=1)
        sim.step(500)
        body = sim.particles["water"].read(["position", "pressure"])
        corner = np.array(place.get("lower", (0.0, 0.0))) + place.get("origin", (0.0, 0.0))
        return body["position"] - corner, body["pressure"]

    near, moved = run(), run(origin=(1e4, 2e4))
    far = run(lower=(1e4, 2e4))
    np.testing.assert_array_equal(moved[1], near[1])
    scale = scenes.WATER * scenes.GRAVITY * 0.8
    assert np.abs(far[1] - near[1]).max() < 1e-5 * scale
    assert np.abs(far[0] - near[0]).max() < 1e-5 * 0.1
