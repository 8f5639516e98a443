"""Blocks that hit a rigid wall in air, ordered and random (Bonus 2023, 10.3 and 10.4).

Expected duration: 20 s on two cores (nine runs of 1e7 and six of 1e7 to 5e7 particle-steps).
"""

import numpy as np
import pytest

from support.examples import debris_study

pytestmark = pytest.mark.validation

# A block that hits head-on, parts of v A sqrt(rho E) and 2 m v: V1 of the digest of chapters 7 to
# 12. The bar's own bands, at 0.01 m, are in `test_bar_impact`.
PLATEAU, IMPULSE = 0.10, 0.05
# Front rows of one, two and four blocks: load in proportion to their number at 0 degrees, and the
# same within a band about its mean at 45: V3.
PROPORTION, EVEN = 0.10, 0.30


@pytest.fixture
def in_air(monkeypatch):
    return debris_study(monkeypatch, "in_air")


def finished(study, device):
    result = study.run(workers=2 if device == "cpu" else 0, device=device, progress=False)
    assert not result.failed, result
    return result


def test_one_block_at_nine_angles(in_air, device, tmp_path, figure):
    """Largest loads head-on, on the short and the long face; least in the middle third."""
    made = in_air.InAir()
    result = finished(made.angles(tmp_path), device)
    angle, load = result["angle"], result["f_relative"]
    _, axes = figure.new()
    broadside = in_air.LENGTH / in_air.WIDTH
    in_air.figures.angle_curve(axes, angle, load, result["first_relative"], broadside)
    assert made.head_on == pytest.approx(0.1 * 0.05 * np.sqrt(981e6))
    assert result["plateau"][0] == pytest.approx(1, abs=PLATEAU)
    assert load[0] == pytest.approx(1, abs=PLATEAU)
    assert result["turned_back"][0] == pytest.approx(2, rel=IMPULSE)
    assert 30 <= angle[np.argmin(load)] <= 60
    oblique = load[(angle > 0) & (angle < 60)]
    assert (oblique < load[0]).all()
    # The long face has five times the area.
    assert load[-1] == load.max()
    assert 3 < load[-1] < broadside * (1 + PLATEAU)


def test_front_rows(in_air, device, tmp_path):
    """Each block of a row adds its load at 0 degrees; at 45 they come one after another."""
    result = finished(in_air.InAir().arrays(tmp_path), device)
    rows = {(row["angle"], row["count"]): row["f_relative"] for row in result.rows}
    for count in (2, 4):
        assert rows[0, count] / rows[0, 1] == pytest.approx(count, rel=PROPORTION)
    turned = np.array([rows[45, count] for count in (1, 2, 4)])
    assert np.abs(turned / turned.mean() - 1).max() < EVEN


def test_random_fields_turn_back(in_air, device, tmp_path):
    """At the end all blocks have been stopped, none gained energy; the table knows the fields."""
    made = in_air.InAir(cell_size=0.025, blocks=8)
    result = finished(made.random(tmp_path, 3), device)
    assert (result["turned_back"] > 1).all() and (result["turned_back"] < 2).all()
    fields = [made.field(seed) for seed in result["seed"]]
    assert result["c"].tolist() == [len(field) for field in fields]
    assert min(field.gaps().min() for field in fields) >= in_air.GAP
