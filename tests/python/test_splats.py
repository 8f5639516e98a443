"""What a pixel of a picture shows: bodies without holes, and what is nearest in front."""

import matplotlib
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

import libmpm
from libmpm import boundaries, materials, shapes
from libmpm._src.pictures import panel as panels
from libmpm._src.pictures.directions import View
from libmpm._src.pictures.figures import Picture
from libmpm._src.pictures.pixels import _eroded

matplotlib.use("Agg", force=False)


WOOD = materials.FixedCorotated(density=600, youngs_modulus=1e6)


def pixels(picture):
    """The picture (height, width, 3), row 0 below."""
    canvas = FigureCanvasAgg(picture)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[::-1, :, :3] / 255.0


def at(picture, axes, image, point):
    """The colour at a point of the axes, m."""
    x, y = axes.transData.transform(point)
    return image[int(y), int(x)]


def colour(name):
    return np.array(matplotlib.colors.to_rgb(name))


def scene_in_space(**boxes):
    """A scene of solid boxes and one rigid one, cells of 0.1 m."""
    scene = libmpm.Scene(cell_size=0.1, lower=(0, 0, 0), upper=(2, 1, 1))
    for name, (lower, upper) in boxes.items():
        if name == "pier":
            scene.add_boundary(name=name, shape=shapes.Box(lower=lower, upper=upper),
                               response=boundaries.Slip())  # fmt: skip
        else:
            scene.add_body(name=name, shape=shapes.Box(lower=lower, upper=upper),
                           material=WOOD)  # fmt: skip
    return scene


@pytest.mark.parametrize("size", [(3, 2), (9, 6)])
def test_bodies_have_no_holes_at_any_size(size):
    scene = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(3, 2), gravity=(0, -9.81))
    scene.add_body(name="water", shape=shapes.Box(lower=(0, 0), upper=(2, 1)),
                   material=materials.TaitFluid())  # fmt: skip
    picture = Picture(figsize=size)
    axes = picture.add_subplot()
    libmpm.Simulation(scene, device="cpu").plot(None, axes=axes)
    image = pixels(picture)
    low, high = (axes.transData.transform(p).astype(int) for p in ((0.06, 0.06), (1.94, 0.94)))
    inside = image[low[1] : high[1], low[0] : high[0]]
    blue = colour(panels.body_colours(scene)["water"])
    assert np.abs(inside - blue).max() < 0.02, "a lattice of dots would leave white between"
    # The body ends where its material does: half a spacing beyond the last particle.
    for x, inside_too in ((1.98, True), (2.03, False)):
        away = np.abs(at(picture, axes, image, (x, 0.5)) - blue).max()
        assert (away < 0.3) == inside_too


@pytest.mark.parametrize(("gap", "closed"), [(0.06, True), (0.12, True), (0.2, False)])
def test_gaps_that_the_grid_bridges_are_closed_and_wider_ones_are_seen(gap, closed):
    scene = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(3, 2), gravity=(0, -9.81))
    for name, low in (("water", 0.5), ("rest", 2.5)):
        scene.add_body(name=name, shape=shapes.Box(lower=(low, 0), upper=(low + 0.4, 1)),
                       material=materials.TaitFluid())  # fmt: skip
    picture = Picture(figsize=(9, 6))
    axes = picture.add_subplot()
    panel = panels.Panel(axes, scene, "xy", 1, bodies=["water"], norm=matplotlib.colors.Normalize())
    x, y = np.meshgrid(np.arange(0.525, 1.5, 0.05), np.arange(0.025, 1.0, 0.05))
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    points[points[:, 0] > 1.0, 0] += gap  # a slit of that width between the materials
    panel.show({"water": panels.Dots(points, None)})
    image = pixels(picture)
    blue = colour(panels.body_colours(scene)["water"])
    slit = at(picture, axes, image, (1.0 + gap / 2, 0.5))
    assert (np.abs(slit - blue).max() < 0.3) == closed
    # Nothing is drawn beyond the walls, though a disc would reach there.
    assert np.abs(at(picture, axes, image, (0.8, -0.02)) - blue).max() > 0.3


def test_titles_and_labels_lie_in_the_picture():
    for upper in ((2, 1), (12, 1), (1, 2)):
        scene = libmpm.Scene(dimension=2, cell_size=0.05, lower=(0, 0), upper=upper,
                             gravity=(0, -9.81), name="a tank")  # fmt: skip
        scene.add_body(name="water", shape=shapes.Box(lower=(0, 0), upper=(0.5, 0.5)),
                       material=materials.TaitFluid())  # fmt: skip
        scene.add_sensor(name="gauge", sensor=libmpm.sensors.WaveGauge(position=(0.7,),
                                                                      interval=0.1))  # fmt: skip
        for picture in (libmpm.Simulation(scene, device="cpu").plot("speed"), scene.preview()):
            canvas = FigureCanvasAgg(picture)
            canvas.draw()
            whole = picture.bbox
            for axes in picture.axes:
                box = axes.get_tightbbox(canvas.get_renderer())
                assert box.x0 >= 0 and box.y0 >= 0, upper
                assert box.x1 <= whole.x1 and box.y1 <= whole.y1, upper


def test_the_nearer_body_hides_the_other():
    near = ((0.5, 0.1, 0.2), (1.0, 0.3, 0.8))
    far = ((0.5, 0.6, 0.2), (1.5, 0.9, 0.8))
    scene = scene_in_space(front=near, back=far)
    colours = panels.body_colours(scene)
    assert colours["front"] != colours["back"]
    picture = Picture(figsize=(6, 4))
    axes = picture.add_subplot()
    libmpm.Simulation(scene, device="cpu").plot(None, planes="xz", axes=axes)
    image = pixels(picture)

    def shows(point):
        seen = at(picture, axes, image, point)
        # Light changes how bright it is, not which of the two colours it has.
        along = {n: seen @ colour(c) / np.linalg.norm(colour(c)) for n, c in colours.items()}
        return max(along, key=along.get)

    assert shows((0.75, 0.5)) == "front" and shows((1.25, 0.5)) == "back"
    # From above, neither is in the way of the other.
    picture = Picture(figsize=(6, 4))
    axes = picture.add_subplot()
    libmpm.Simulation(scene, device="cpu").plot(None, planes="xy", axes=axes)
    image = pixels(picture)
    assert shows((0.75, 0.2)) == "front" and shows((0.75, 0.75)) == "back"


@pytest.mark.parametrize("shape", ["box", "sphere"])
def test_structures_hide_and_are_hidden(shape):
    scene = scene_in_space(back=((0.5, 0.7, 0.2), (1.5, 0.9, 0.8)))
    rigid = (
        shapes.Box(lower=(0.6, 0.2, 0.3), upper=(1.0, 0.5, 0.7))
        if shape == "box"
        else shapes.Sphere(centre=(0.8, 0.35, 0.5), radius=0.2)
    )
    scene.add_boundary(name="pier", shape=rigid, response=boundaries.Slip())
    orange = colour(panels.body_colours(scene)["back"])
    sim = libmpm.Simulation(scene, device="cpu")
    for bodies, seen_orange in (("front", False), ("behind", True)):
        picture = Picture(figsize=(6, 4))
        axes = picture.add_subplot()
        # Looking along y the pier is in front; "zx" looks from the other side.
        plane, point = ("xz", (0.8, 0.5)) if bodies == "front" else ("zx", (0.5, 0.8))
        sim.plot(None, planes=plane, axes=axes)
        seen = at(picture, axes, pixels(picture), point)
        grey = np.ptp(seen) < 0.03
        assert grey != seen_orange and (np.argmax(seen) == np.argmax(orange)) >= seen_orange


def test_oblique_view_is_a_rotation_seen_from_above():
    for vertical in (0, 1, 2):
        view = View.oblique(vertical)
        basis = np.stack([view.right, view.up, view.towards])
        np.testing.assert_allclose(basis @ basis.T, np.eye(3), atol=1e-12)
        assert view.up[vertical] > 0.8 and view.towards[vertical] > 0.2
        assert abs(view.right[vertical]) < 1e-12
        assert np.linalg.det(basis) == pytest.approx(1.0), "no mirror image"
    flat, depth = View.along(3, 0, 2).project(np.array([[1.0, 2.0, 3.0]]))
    assert flat.tolist() == [[1.0, 3.0]] and depth.tolist() == [-2.0]


def test_pictures_from_above_a_corner(tmp_path):
    scene = scene_in_space(
        front=((0.5, 0.1, 0.2), (1.0, 0.3, 0.8)), pier=((1.2, 0.2, 0.0), (1.6, 0.6, 0.5))
    )
    sim = libmpm.Simulation(scene, device="cpu")
    picture = sim.plot("speed", planes="3d")
    image = pixels(picture)
    assert (np.ptp(image, axis=-1) > 0.2).sum() > 500 and len(np.unique(image.round(2))) > 30
    assert {t.get_text() for t in picture.axes[0].texts} >= {"x: 0 to 2 m", "z: 0 to 1 m"}
    assert scene.preview(planes="3d")._repr_png_().startswith(b"\x89PNG")
    flat = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(1, 1))
    with pytest.raises(libmpm.Error, match="planes has '3d'"):
        flat.preview(planes="3d")


def test_a_cut_shows_what_is_near_it():
    scene = scene_in_space(
        front=((0.5, 0.1, 0.2), (1.0, 0.3, 0.8)), back=((0.5, 0.6, 0.2), (1.5, 0.9, 0.8))
    )
    sim = libmpm.Simulation(scene, device="cpu")
    axes = sim.plot(None, planes="xz", cut=(0.5, 0.75, 0.5)).axes[0]
    shown = {
        c.get_label(): len(c.get_offsets()) for c in axes.collections if c.get_label()[0] != "_"
    }
    assert shown["front"] == 0 and shown["back"] > 100
    with pytest.raises(libmpm.Error, match=r"cut is \[1.0\]; expected a point"):
        sim.plot(cut=(1.0,))


def test_pieces_of_debris_share_a_colour_and_one_entry_of_the_legend():
    scene = libmpm.Scene(cell_size=0.1, lower=(0, 0, 0), upper=(2, 1, 1))
    for k in range(12):
        low = (0.1 + 0.15 * k, 0.1, 0.1)
        scene.add_body(name=f"log-{k}", shape=shapes.Box(lower=low, upper=(low[0] + 0.1, 0.2, 0.2)),
                       material=WOOD)  # fmt: skip
    scene.add_body(name="sea", shape=shapes.Box(lower=(0, 0.5, 0), upper=(2, 1, 0.3)),
                   material=materials.TaitFluid())  # fmt: skip
    colours = panels.body_colours(scene)
    assert len({colours[f"log-{k}"] for k in range(12)}) == 1 and colours["sea"] != colours["log-0"]
    assert panels.legend_of(colours)[1] == ["log (12)", "sea"]


def test_load_cells_are_drawn_on_their_faces(tank):
    scene = tank()
    scene.add_body(name="water", shape=shapes.Box(lower=(0, 0), upper=(0.3, 0.3)),
                   material=materials.TaitFluid())  # fmt: skip
    scene.add_boundary(name="pier", shape=shapes.Box(lower=(0.5, 0), upper=(0.6, 0.4)),
                       response=boundaries.Slip())  # fmt: skip
    cell = libmpm.sensors.LoadCell(boundary="pier", faces=("x-",), interval=0.01)
    scene.add_sensor(name="load", sensor=cell)
    axes = scene.preview().axes[0]
    lines = [line.get_xydata() for line in axes.lines if line.get_color() == "#D55E00"]
    assert len(lines) == 1
    np.testing.assert_allclose(lines[0], [(0.5, 0.0), (0.5, 0.4)])
    assert "load" in {t.get_text() for t in axes.texts}


@pytest.fixture
def instruments():
    """A scene in space with a load cell on a pier off the middle, a gauge and a probe."""
    scene = scene_in_space(
        front=((0.5, 0.1, 0.2), (1.0, 0.3, 0.8)), pier=((1.2, 0.5, 0.0), (1.6, 0.9, 0.5))
    )
    given = {
        "load": libmpm.sensors.LoadCell(boundary="pier", faces=("x-",), interval=0.01),
        "gauge": libmpm.sensors.WaveGauge(position=(0.3, 0.4), interval=0.01),
        "probe": libmpm.sensors.PressureProbe(position=(0.7, 0.2, 0.3), interval=0.01),
    }
    for name, sensor in given.items():
        scene.add_sensor(name=name, sensor=sensor)
    return scene


def test_instruments_are_drawn_in_a_view_from_above_a_corner(instruments):
    (axes,) = instruments.preview(planes="3d").axes
    assert {"load", "gauge", "probe"} <= {t.get_text() for t in axes.texts}
    orange = [line.get_xydata() for line in axes.lines if line.get_color() == "#D55E00"]
    assert len(orange) == 4, "the edges of the one face that is measured"
    view = View.oblique(2)
    corners = np.array([(1.2, y, z) for y in (0.5, 0.9) for z in (0.0, 0.5)])
    expected = view.project(corners)[0]
    for edge in orange:
        for end in edge:
            assert np.abs(expected - end).sum(axis=1).min() < 1e-12
    gauge = next(line for line in axes.lines if line.get_linestyle() == "-.")
    ends = view.project(np.array([(0.3, 0.4, 0.0), (0.3, 0.4, 1.0)]))[0]
    np.testing.assert_allclose(gauge.get_xydata(), ends)


def test_a_plot_in_space_is_cut_through_what_carries_the_load_cell(instruments):
    sim = libmpm.Simulation(instruments, device="cpu")
    picture = sim.plot(None)
    elevation, plan = picture.axes
    assert "cut at y = 0.7 m" in elevation.get_title(loc="left")
    assert plan.get_title(loc="left") == ""
    shown = {
        axes: next(len(c.get_offsets()) for c in axes.collections if c.get_label() == "front")
        for axes in picture.axes
    }
    assert shown[elevation] == 0 and shown[plan] == len(sim.particles["front"])
    texts = {t.get_text() for t in picture.legends[0].get_texts()}
    assert texts == {"load cell", "gauge", "probe"}, "one body needs no legend"


def test_three_views_have_one_scale(instruments):
    picture = instruments.preview()
    FigureCanvasAgg(picture).draw()
    scales = [a.bbox.width / np.ptp(a.get_xlim()) for a in picture.axes]
    assert max(scales) < 1.15 * min(scales)
    wide, tall = picture.get_size_inches() * picture.dpi
    covered = sum(a.bbox.width * a.bbox.height for a in picture.axes)
    assert covered > 0.4 * wide * tall, "half empty"


@pytest.mark.parametrize("radius", [1.0, 2.5, 6.3])
def test_what_is_farther_than_a_radius_from_the_rest_is_found_exactly(radius):
    mask = np.random.default_rng(0).random((40, 50)) > 0.02
    rim = 8  # the border counts as not of the mask
    y, x = np.nonzero(~np.pad(mask, rim))
    down, along = np.mgrid[0:40, 0:50] + rim
    away = np.min((down[..., None] - y) ** 2 + (along[..., None] - x) ** 2, axis=-1)
    kept = _eroded(mask, radius)
    np.testing.assert_array_equal(kept, mask & (away > radius**2))
    assert kept.any() and (mask & ~kept).any()
