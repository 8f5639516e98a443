"""Which viscous flows along held walls are warned of before they run.

The runs behind it are in `tests/validation/test_viscous_walls.py`. Expected duration: 2 s.
"""

import pytest

import libmpm
from libmpm import Method, boundaries, materials, shapes

MUD = materials.HerschelBulkleyFluid(
    density=1000.0, bulk_modulus=4e7, yield_stress=5000.0, consistency=1000.0, index=1.0,
    largest_viscosity=1e4,
)  # fmt: skip
OIL = materials.TaitFluid(density=1000.0, bulk_modulus=2.5e6, viscosity=1000.0)
WATER = materials.TaitFluid(bulk_modulus=1e6, viscosity=1e-3)


def channel(material, response, *, cells=16, faces=("y-", "y+"), height=1.0, **method):
    dx = 1.0 / cells
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=(0.0, 0.0), upper=(4.0, 1.0), method=Method(**method)
    )
    scene.add_body(
        name="fluid", shape=shapes.Box(lower=(0.5, 0.0), upper=(3.5, height)), material=material
    )
    scene.add_boundary(name="plates", shape=shapes.DomainWalls(faces=faces), response=response)
    return scene


def warnings_of(scene):
    return [w for w in scene.plan(device="cpu").warnings if "along face" in w]


STICKY, MIRROR = boundaries.Sticky(), boundaries.Mirror(slip=False)


@pytest.mark.parametrize("material", [MUD, OIL])
def test_the_warning_names_the_error_and_the_cure(material):
    with pytest.warns(libmpm.ModelWarning, match="along face 'y-'"):
        channel(material, STICKY).validate()
    (told,) = warnings_of(channel(material, STICKY))
    assert "body 'fluid'" in told and "'APIC' and Sticky()" in told
    assert "use 'FLIP' or 'AFLIP' with boundaries.Mirror(slip=False)" in told


@pytest.mark.parametrize(
    ("scene", "warned"),
    [
        (channel(MUD, MIRROR), True),
        (channel(MUD, MIRROR, transfer="FLIP"), False),
        (channel(MUD, STICKY, transfer="FLIP"), True),
        (channel(OIL, MIRROR), False),
        (channel(OIL, MIRROR, cells=8), True),
        (channel(OIL, STICKY, cells=64), False),
        (channel(OIL, boundaries.Slip()), False),
        (channel(OIL, boundaries.Mirror()), False),
        (channel(WATER, STICKY), False),  # no grid sees its viscosity
        (channel(OIL, STICKY, faces=("y+",), height=0.5), False),  # touches no held face
        (channel(OIL, {"y-": boundaries.Sticky(), "y+": boundaries.Slip()}), True),
        (channel(OIL, {"y-": MIRROR, "y+": boundaries.Slip()}), False),
    ],
)
def test_where_it_is_said(scene, warned):
    assert bool(warnings_of(scene)) == warned


def test_a_film_on_a_plate_is_half_a_channel():
    (told,) = warnings_of(channel(OIL, STICKY, faces=("y-",), height=0.5))
    assert "16 cells between the plates" in told


FLOORS = {
    "box": shapes.Box(lower=(0.0, -0.25), upper=(4.0, 0.0)),
    "turned box": shapes.OrientedBox(centre=(2.0, -0.125), size=(4.0, 0.25), angle=0),
    "half space": shapes.HalfSpace(point=(0.0, 0.0), normal=(0.0, 1.0)),
    "height field": shapes.HeightField(x=(0.0, 4.0), z=(0.0, 0.0)),
    "polygon": shapes.Extrusion(profile=((0, -0.25), (4, -0.25), (4, 0), (0, 0))),
}


@pytest.mark.parametrize("floor", FLOORS)
@pytest.mark.parametrize("lid", [True, False])
def test_solids_are_plates_too(lid, floor):
    """Faces of the domain and solids hold nodes alike: a box under mud was not looked at."""
    scene = channel(MUD, STICKY, faces=("x-",))
    told = scene.to_dict() | {"lower": [0.0, -0.25], "upper": [4.0, 1.25]}
    scene = libmpm.Scene.from_dict(told)
    scene.add_boundary(name="floor", shape=FLOORS[floor], response=STICKY)
    if lid:
        above = shapes.Box(lower=(0.0, 1.0), upper=(4.0, 1.25))
        scene.add_boundary(name="lid", shape=above, response=STICKY)
    (said,) = [w for w in scene.plan(device="cpu").warnings if "a flow of it along" in w]
    assert "along boundary 'floor' would have" in said
    assert f"{16 if lid else 32} cells between the plates" in said


def test_solids_beside_away_or_aslope_are_no_plates():
    scene = channel(MUD, STICKY, faces=("x-",))
    scene = libmpm.Scene.from_dict(scene.to_dict() | {"lower": [0.0, -0.25]})
    for name, lower, upper in (
        ("beside", (0.0, -0.25), (0.25, 0.0)),
        ("below", (0.5, -0.25), (3.5, -0.125)),
    ):
        box = shapes.Box(lower=lower, upper=upper)
        scene.add_boundary(name=name, shape=box, response=STICKY)
    slope = shapes.HalfSpace(point=(0.5, 0.0), normal=(-0.2, 1.0))
    scene.add_boundary(name="slope", shape=slope, response=STICKY)
    told = scene.plan(device="cpu").warnings
    assert not [w for w in told if "a flow of it along" in w]
    # Nobody knows how wrong: that is what is said.
    (said,) = [w for w in told if "has not been measured" in w]
    assert "boundary 'slope', which leans" in said and "turn gravity in place of a slope" in said


def test_kernels_whose_error_is_unknown_are_named():
    (said,) = warnings_of(channel(MUD, STICKY, kernel="cubic"))
    assert "with kernel 'cubic'" in said and "has not been measured" in said
    assert not warnings_of(channel(WATER, STICKY, kernel="cubic"))
