"""Water above a bed that is not level is filled in columns unless something else is asked for."""

import numpy as np
import pytest

import libmpm
from libmpm import materials, shapes

BED = shapes.HalfSpace(point=(0.0, 0.0), normal=(-np.sin(0.1), np.cos(0.1)))
ROOM = shapes.Box(lower=(0.0, 0.0), upper=(4.0, 1.0))
BASIN = shapes.basin(level=0.8, bed=BED, within=ROOM)
WATER = materials.TaitFluid(bulk_modulus=1e6)


def added(shape=BASIN, material=WATER, gravity=(0.0, -9.81), **how) -> libmpm.Scene:
    """Return a scene with one body."""
    scene = libmpm.Scene(
        dimension=2, cell_size=0.1, lower=(0, 0), upper=(4, 1), gravity=gravity
    )  # fmt: skip
    scene.add_body(name="water", shape=shape, material=material, **how)
    return scene


def test_columns_are_the_default_above_a_bed():
    scene = added()
    assert scene.bodies[0].sampling == shapes.Columns()
    assert libmpm.Scene.from_dict(scene.to_dict()) == scene
    # Columns begin and end as bed and level do, half of their own spacing inside.
    x = libmpm.Simulation(scene, device="cpu").particles["water"]["position"]
    for place in np.unique(x[:, 0].round(6)):
        y = np.sort(x[np.abs(x[:, 0] - place) < 1e-5, 1])
        if len(y) > 2:
            spacing = (0.8 - place * np.tan(0.1)) / len(y)
            np.testing.assert_allclose(y[0], place * np.tan(0.1) + spacing / 2, atol=1e-5)
            np.testing.assert_allclose(y[-1], 0.8 - spacing / 2, atol=1e-5)


@pytest.mark.parametrize(
    "how",
    [{"sampling": None}, {"shape": shapes.Box(lower=(0, 0), upper=(1, 0.8))},
     {"shape": ROOM - shapes.Box(lower=(1, 0), upper=(2, 0.2))}, {"gravity": (0.0, 0.0)},
     {"material": materials.FixedCorotated(density=1000, youngs_modulus=1e6, poissons_ratio=0.3)},
     {"shape": shapes.Sphere(centre=(1, 0.5), radius=0.2)}],
)  # fmt: skip
def test_all_else_is_a_lattice(how):
    assert added(**how).bodies[0].sampling is None


def test_what_is_asked_for_stays():
    jitter = shapes.Jitter(share=0.1, seed=1)
    assert added(sampling=jitter).bodies[0].sampling == jitter
    with pytest.raises(libmpm.SceneError, match="sampling"):
        added(sampling="columns")
