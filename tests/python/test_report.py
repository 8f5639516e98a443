"""The picture of a run's report: which panels it has, and how many a row."""

import pytest
from matplotlib.figure import Figure

import libmpm
from libmpm import boundaries, materials, sensors, shapes
from libmpm._src.output import report


def scene():
    made = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(2, 1), gravity=(0, -9.81))
    box = shapes.Box(lower=(0, 0), upper=(0.5, 0.5))
    made.add_body(name="water", shape=box, material=materials.TaitFluid(bulk_modulus=1e5))
    made.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
    made.add_sensor(name="load", sensor=sensors.LoadCell(boundary="walls", interval=0.005))
    return made


@pytest.fixture
def drawn(monkeypatch, tmp_path):
    """What `draw` shows of a run of a scene, as its axes."""

    def draw(of, **output):
        made = libmpm.Output(tmp_path / "out", overwrite=True, **output)
        sim = libmpm.Simulation(of, device="cpu", threads=1, output=made)
        sim.run(until=0.1, progress=False)
        sim.close()
        shown = []
        monkeypatch.setattr(Figure, "savefig", lambda self, *a, **k: shown.append(self))
        report.draw(tmp_path / "out")
        (figure,) = shown
        figure.canvas.draw()
        return figure.axes

    return draw


pytestmark = pytest.mark.filterwarnings("ignore::libmpm.ModelWarning")


def test_without_gauges_there_is_one_curve_panel(drawn):
    (axes,) = drawn(scene())
    assert axes.get_title() == "Load on the structure" and len(axes.lines) >= 1


@pytest.mark.parametrize(
    "gauge", [sensors.WaveGauge(position=(0.3,), interval=0.01),
              sensors.ElevationGauge(position=(0.3,), interval=0.01)]
)  # fmt: skip
def test_gauges_have_a_panel_over_the_same_times(drawn, gauge):
    made = scene()
    made.add_sensor(name="gauge", sensor=gauge)
    force, level = drawn(made)
    assert level.get_title() == "Gauges" and len(level.lines) == 1
    assert force.get_xlim() == level.get_xlim()


def test_plane_scenes_show_two_moments_a_row(drawn):
    _, *snapshots, bar = drawn(scene(), frame_interval=0.02)
    assert bar.get_ylabel() == "speed [m/s]" and len(snapshots) >= 3
    left = [round(a.get_position().x0, 2) for a in snapshots]
    assert left[0] == left[2] < left[1] and snapshots[0].get_title(loc="left") == "0.00 s"


@pytest.mark.parametrize(("unit", "written"), [("N", "N·s"), ("N/m", "N·s/m")])
def test_the_impulse_has_the_unit_of_one(unit, written):
    load = report.LoadSummary(
        "load", "force_x", unit, 0.001, 0.0, 0.1, 800.0, 0.1, 900.0, 0.2, 350.0
    )
    rows = report.table([load], 1e6, 1.0, 1000).splitlines()
    assert next(row for row in rows if "impulse" in row).endswith(f"350.0 {written}")
