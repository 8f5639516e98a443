"""What pictures show: how many particles, which colours, what files; not how pixels fall.

Expected duration: 12 s.
"""

import importlib
import json
import math
import re
import sys
import warnings
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PathCollection

import libmpm
from libmpm import boundaries, materials, sensors, shapes
from libmpm._src.base.tables import html_table
from libmpm._src.pictures import animate as films
from libmpm._src.pictures import figures as common
from libmpm._src.pictures import outlines
from libmpm._src.run import progress

matplotlib.use("Agg", force=False)


@pytest.fixture(autouse=True)
def quiet():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", libmpm.ModelWarning)
        yield


def dots(axes, label=None):
    """The particles in a picture, by body."""
    found = {c.get_label(): c for c in axes.collections if isinstance(c, PathCollection)}
    return found if label is None else found[label]


def panels(picture):
    return [a for a in picture.axes if a.get_label() != "<colorbar>"]


def counts(scene):
    return {b: scene.plan(device="cpu").body(b)["particles"] for b in ("water", "block")}


# Which particles are drawn ------------------------------------------------------------------


@pytest.mark.parametrize("count", [1, 7, 1000, 12345])
@pytest.mark.parametrize("most", [1, 3, 999, 10000])
def test_chosen_particles_are_distinct_even_and_always_the_same(count, most):
    rows = common.chosen(count, most)
    assert len(rows) <= most and np.all(np.diff(rows) > 0)
    assert rows.min() >= 0 and rows.max() < count
    np.testing.assert_array_equal(rows, common.chosen(count, most))
    if count <= most:
        assert len(rows) == count
    else:
        assert len(rows) >= 0.6 * most
        # No run of ids is left out for longer than two shares.
        gaps = np.diff(np.concatenate([[-1], rows, [count]]))
        assert gaps.max() <= 2 * math.ceil(count / most) + 1


def test_a_lattice_is_not_drawn_in_stripes():
    rows = common.chosen(100 * 100, 1000)
    column = np.bincount(rows % 100, minlength=100)  # every tenth particle would fill ten of them
    assert np.count_nonzero(column) >= 95 and column.max() <= 25


def test_small_bodies_are_drawn_whole():
    assert common.shares([10_000, 50, 30], 1000) == [920, 50, 30]
    assert common.shares([10_000, 9_000], 1000) == [500, 500]
    assert common.shares([3, 4], 1000) == [3, 4]
    assert sum(common.shares([100] * 7, 50)) <= 50
    with pytest.raises(libmpm.Error, match="most is 0; expected a whole number"):
        common.shares([3], 0)


# Previews -------------------------------------------------------------------------------------


def test_preview_shows_all_parts(scene):
    picture = scene.preview()
    faces = panels(picture)
    assert [a.get_xlabel() + a.get_ylabel() for a in faces] == [
        "x [m]z [m]", "y [m]z [m]", "x [m]y [m]",
    ]  # fmt: skip
    for axes in faces:
        for body, count in counts(scene).items():
            assert len(dots(axes, body).get_offsets()) == count
    assert "particles drawn" not in picture.get_suptitle()
    texts = {t.get_text() for t in faces[0].texts}
    assert {"gauge", "probe"} <= texts
    labels = {t.get_text() for t in picture.legends[0].get_texts()}
    assert {"water", "block", "walls: slip", "walls: sticky", "pier: separable"} <= labels
    pier = [p for p in faces[0].patches if np.allclose(p.get_bbox().bounds, (2.0, 0, 0.4, 0.8))]
    assert len(pier) == 1
    assert picture._repr_png_().startswith(b"\x89PNG")


def test_preview_draws_no_more_than_asked_for_and_says_so(scene):
    total = sum(counts(scene).values())
    picture = scene.preview(most=200, planes="xz")
    (axes,) = panels(picture)
    drawn = sum(len(c.get_offsets()) for c in dots(axes).values())
    assert 150 < drawn <= 200
    assert f"{drawn} of {total:,} particles drawn" in picture.get_suptitle()
    again = panels(scene.preview(most=200, planes="xz"))[0]
    np.testing.assert_array_equal(
        dots(axes, "water").get_offsets(), dots(again, "water").get_offsets()
    )


def test_a_cut_shows_what_is_near_it(scene):
    axes = panels(scene.preview(cut=(0.65, 0.4, 0.3), planes=["xz"]))[0]
    assert axes.get_title() == "cut at y = 0.4 m"
    whole = panels(scene.preview(planes=["xz"]))[0]
    near, every = (len(dots(a, "water").get_offsets()) for a in (axes, whole))
    # A cell either side of 0.8 m: a quarter, less what the block takes from the middle.
    assert 0.15 * every < near < 0.25 * every
    off = panels(scene.preview(cut=(0.65, 0.05, 0.3), planes=["xz"]))[0]
    piers = [
        len([p for p in a.patches if p.get_width() == pytest.approx(0.4)]) for a in (axes, off)
    ]
    assert piers == [1, 0], "the pier reaches from 0.2 to 0.6"
    with pytest.raises(libmpm.Error, match=r"cut is \[1.0\]; expected a point"):
        scene.preview(cut=(1.0,))
    with pytest.raises(libmpm.Error, match="planes has 'xw'"):
        scene.preview(planes="xw")
    with pytest.raises(libmpm.Error, match="backend is 'vtk'"):
        scene.preview(backend="vtk")


def test_zones_of_inlets_and_outlets_are_drawn(tank):
    scene = tank()
    scene.add_body(name="water", shape=shapes.Box(lower=(0, 0), upper=(1.0, 0.3)),
                   material=materials.TaitFluid())  # fmt: skip
    scene.add_flow(name="river", flow=boundaries.Inflow(body="water", face="x-", velocity=1.0))
    scene.add_flow(name="sea", flow=boundaries.Outflow(face="x+", zone=2))
    picture = scene.preview()
    zones = {p.get_bbox().bounds for p in panels(picture)[0].patches if p.get_hatch()}
    assert {tuple(np.round(z, 9)) for z in zones} == {(0, 0, 0.3, 1.0), (0.8, 0, 0.2, 1.0)}
    labels = {t.get_text() for t in picture.legends[0].get_texts()}
    assert {"river: inflow", "sea: outflow"} <= labels
    assert {"river", "sea"} <= set(cells_of(scene._repr_html_()))


def test_general_solids_are_drawn_where_their_distance_is_zero(tank):
    scene = tank(origin=(100.0, 50.0))
    scene.add_body(name="w", shape=shapes.Box(lower=(0, 0), upper=(0.3, 0.3)),
                   material=materials.TaitFluid())  # fmt: skip
    scene.add_boundary(name="pile", shape=shapes.Sphere(centre=(0.6, 0.5), radius=0.2),
                       response=boundaries.Sticky())  # fmt: skip
    (axes,) = panels(scene.preview())
    lines = [c for c in axes.collections if not isinstance(c, PathCollection)]
    points = np.concatenate([p.vertices for c in lines for p in c.get_paths() if len(p.vertices)])
    away = np.linalg.norm(points - (100.6, 50.5), axis=1)
    # The distance is interpolated linearly over 1/200 of the diameter.
    on_it = np.abs(away - 0.2) < 1e-4
    assert on_it.sum() > 100
    assert points[on_it, 0].min() == pytest.approx(100.4, abs=1e-3)
    assert points[on_it, 0].max() == pytest.approx(100.8, abs=1e-3)


@pytest.mark.parametrize("plane", ["xz", "zx", "xy", "yz"])
def test_shadows_and_cuts_of_solids_lie_where_the_solid_is(plane):
    scene = libmpm.Scene(cell_size=0.1, lower=(0, 0, 0), upper=(2, 1, 1.5))
    ball = shapes.Sphere(centre=(1.4, 0.3, 0.9), radius=0.25)
    middle = {"x": 1.4, "y": 0.3, "z": 0.9}
    for cut in (None, (1.4, 0.3, 0.9)):
        picture = common.Picture()
        axes = picture.add_subplot()
        outlines.draw_shape(axes, outlines.Plane(scene, plane, cut), ball, color="k")
        points = np.concatenate([p.vertices for c in axes.collections for p in c.get_paths()])
        box = np.stack([points.min(axis=0), points.max(axis=0)])
        expected = np.array([[middle[a] - 0.25, middle[a] + 0.25] for a in plane]).T
        # Shadows are sampled at 64 places along the longest edge.
        assert np.abs(box - expected).max() < 0.02, cut


def test_a_scene_that_cannot_run_is_drawn_with_its_problem(tank):
    scene = tank()
    scene.add_body(name="water", shape=shapes.Box(lower=(0.2, 0.2), upper=(1.5, 0.5)),
                   material=materials.TaitFluid())  # fmt: skip
    with pytest.raises(libmpm.SceneError) as refused:
        scene.validate()
    picture = scene.preview()
    assert "cannot run yet" in picture.get_suptitle()
    assert refused.value.problems[0][:60] in picture.get_suptitle()
    assert not dots(panels(picture)[0])


def _flume(length, name="", gauge=False):
    scene = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(length, 1.0),
                         gravity=(0, -9.81), name=name)  # fmt: skip
    scene.add_body(name="water", shape=shapes.Box(lower=(0, 0), upper=(length / 2, 0.5)),
                   hydrostatic=0.5, material=materials.TaitFluid(bulk_modulus=1e5))  # fmt: skip
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
    if gauge:
        place = sensors.ElevationGauge(position=(0.99 * length,), interval=1e-2)
        scene.add_sensor(name="gauge at the far end", sensor=place)
    return scene


def _cut_off(picture):
    """Texts of a picture as it is drawn first that reach beyond it."""
    canvas = FigureCanvasAgg(picture)
    canvas.draw()
    renderer = canvas.get_renderer()
    hidden = set()
    for axes in picture.axes:
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            hidden |= {tick.label1 for tick in axis.get_major_ticks()
                       if not low <= tick.get_loc() <= high}  # fmt: skip
    found = []
    for text in picture.findobj(matplotlib.text.Text):
        box = text.get_window_extent(renderer)
        over = max(-box.x0, -box.y0, box.x1 - picture.bbox.width, box.y1 - picture.bbox.height)
        if text.get_text().strip() and text.get_visible() and text not in hidden and over > 0.5:
            found.append(text.get_text())
    return found


@pytest.mark.parametrize("length", [0.2, 0.6, 0.8, 2.4, 6.0, 20.0])
@pytest.mark.parametrize("name", ["surge", 8 * "a flume with a long name "])
def test_no_label_is_cut_off_when_a_picture_is_drawn_first(length, name):
    for gauge in (False, True):
        scene = _flume(length, name, gauge)
        run = libmpm.Simulation(scene, device="cpu")
        for picture in (run.plot("pressure"), run.plot(None) if gauge else scene.preview()):
            assert _cut_off(picture) == []
            # Nor is it laid out anew when it is drawn again: frames of films stay in their place.
            before = panels(picture)[0].get_position().bounds
            picture.canvas.draw()
            assert panels(picture)[0].get_position().bounds == pytest.approx(before, abs=2e-3)


def test_pictures_are_filled_by_flat_and_by_tall_scenes():
    for length in (0.25, 6.0):
        scene = libmpm.Scene(dimension=2, cell_size=0.05, lower=(0, 0), upper=(length, 1.0))
        scene.add_body(name="water", shape=shapes.Box(lower=(0, 0), upper=(length, 0.5)),
                       material=materials.TaitFluid())  # fmt: skip
        picture = libmpm.Simulation(scene, device="cpu").plot("pressure")
        FigureCanvasAgg(picture).draw()
        (axes,) = panels(picture)
        wide, tall = axes.bbox.width / picture.bbox.width, axes.bbox.height / picture.bbox.height
        assert max(wide, tall) > 0.65, (length, wide, tall)
        assert picture.get_figheight() < 11.0, "longer than a page"


def test_legends_have_as_many_columns_as_fit(tank):
    scene = tank()
    timber = materials.FixedCorotated(density=500, youngs_modulus=1e5)
    for k in range(4):
        place = shapes.Box(lower=(0.25 * k, 0), upper=(0.25 * k + 0.2, 0.2))
        scene.add_body(
            name="container of the northern quay " + "abcd"[k], shape=place, material=timber
        )
    assert _cut_off(scene.preview()) == []
    assert _cut_off(libmpm.Simulation(scene, device="cpu").plot(None)) == []


# Plots of a moment --------------------------------------------------------------------------


@pytest.fixture
def run(scene):
    simulation = libmpm.Simulation(scene, device="cpu")
    simulation.step(10)
    return simulation


def test_plot_colours_by_an_attribute(run):
    picture = run.plot("pressure")
    elevation, plan = panels(picture)
    water = run.particles["water"]
    image = dots(plan, "water")
    np.testing.assert_allclose(np.sort(image.get_array()), np.sort(water["pressure"]))
    near = dots(elevation, "water")
    assert 0 < len(near.get_array()) < len(image.get_array()), "a slice"
    both = np.concatenate([water["pressure"], run.particles["block"]["pressure"]])
    assert image.get_clim() == pytest.approx(tuple(np.percentile(both, (0.5, 99.5))))
    assert dots(elevation, "block").get_clim() == image.get_clim(), "one scale for all"
    position = water["position"]
    np.testing.assert_allclose(np.sort(image.get_offsets()[:, 1]), np.sort(position[:, 1]))
    bar = next(a for a in picture.axes if a.get_label() == "<colorbar>")
    assert bar.get_ylabel() == "pressure [Pa]"
    assert f"{run.time:.4g} s" in elevation.get_title(loc="left")


def test_plot_takes_components_limits_and_axes(run):
    picture = run.plot("velocity_z", limits=(-1.0, 0.5), planes="yz", bodies="water")
    (axes,) = panels(picture)
    image = dots(axes, "water")
    assert image.get_clim() == (-1.0, 0.5)
    assert "block" not in dots(axes)
    np.testing.assert_allclose(
        np.sort(image.get_array()), np.sort(run.particles["water"]["velocity"][:, 2])
    )
    own = common.Picture().add_subplot()
    assert run.plot("stress_xz", axes=own) is own.figure
    np.testing.assert_allclose(
        np.sort(dots(own, "block").get_array()),
        np.sort(run.particles["block"]["stress"][:, 0, 2]),
    )
    lengths = dots(panels(run.plot("velocity", planes="xz"))[0], "water").get_array()
    np.testing.assert_allclose(np.sort(lengths), np.sort(run.particles["water"]["speed"]))
    assert dots(panels(run.plot(None, planes="xz"))[0], "water").get_array() is None


def test_plot_refuses_by_name(run):
    for problem, given in (
        ("colour is 'presure'.*pressure", {"colour": "presure"}),
        ("bodies has 'watr'.*'water'", {"bodies": "watr"}),
        ("limits is \\(2, 1\\)", {"limits": (2, 1)}),
        ("most is -1", {"most": -1}),
        ("velocity has the shape", {"color": "velocity_xy"}),
    ):
        with pytest.raises(libmpm.Error, match=problem):
            run.plot(**given)


def test_bodies_without_the_attribute_are_grey(run):
    faces = panels(run.plot("plastic_strain" if "plastic_strain" in run.particles["block"]
                            else "deformation_gradient_xx", planes="xz"))  # fmt: skip
    assert dots(faces[0], "water").get_array() is None
    assert dots(faces[0], "block").get_array() is not None


def test_spray_is_said_to_lie_beyond_the_colours(run):
    picture = run.plot("speed", planes="xz", limits=(1e-6, 1e3))
    bar = next(c for c in dots(panels(picture)[0]).values() if c.colorbar is not None).colorbar
    assert bar.extend in ("neither", "min")
    assert run.plot("speed", planes="xz", limits=(0.1, 0.2)) is not None


# In space -----------------------------------------------------------------------------------


def test_views_in_space_hold_the_particles(run, scene):
    pyvista = pytest.importorskip("pyvista")
    from libmpm._src.pictures.view_3d import preview_in_space, view

    plotter = view(run, colour="pressure", off_screen=True)
    names = set(plotter.actors)
    assert {"body water", "body block", "boundary pier", "domain"} <= names
    cloud = plotter.actors["body water"].mapper.dataset
    assert cloud.n_points == len(run.particles["water"])
    np.testing.assert_allclose(cloud["pressure [Pa]"], run.particles["water"]["pressure"])
    limits = [plotter.actors[f"body {b}"].mapper.scalar_range for b in ("water", "block")]
    assert limits[0] == limits[1]
    plotter.close()
    plotter = preview_in_space(scene, most=300, off_screen=True)
    drawn = sum(plotter.actors[f"body {b}"].mapper.dataset.n_points for b in ("water", "block"))
    assert drawn <= 300
    assert "sensors-points" in plotter.actors or any("sensors" in n for n in plotter.actors)
    plotter.close()
    ball = shapes.Sphere(centre=(1.0, 0.4, 0.5), radius=0.3)
    from libmpm._src.pictures.view_3d import surface_of

    surface = surface_of(pyvista, scene, ball)
    away = np.linalg.norm(surface.points - (1.0, 0.4, 0.5), axis=1)
    assert surface.n_points > 500 and np.abs(away - 0.3).max() < 2e-3


def test_views_in_space_are_for_three_dimensions(tank, monkeypatch):
    flat = libmpm.Simulation(_small(tank), device="cpu")
    with pytest.raises(libmpm.Error, match="has 2 dimensions; expected 3; use the matplotlib"):
        flat.view()
    monkeypatch.setitem(sys.modules, "pyvista", None)
    scene = libmpm.Scene(cell_size=0.1, lower=(0, 0, 0), upper=(1, 1, 1))
    with pytest.raises(libmpm.SceneError, match=r"pyvista is not installed.*libmpm\[viz\]"):
        scene.preview(backend="pyvista")


# Films --------------------------------------------------------------------------------------


def _small(tank):
    scene = tank(name="drop")
    scene.add_body(name="water", shape=shapes.Box(lower=(0.2, 0.2), upper=(0.5, 0.6)),
                   material=materials.TaitFluid(bulk_modulus=1e5))  # fmt: skip
    scene.add_body(name="block", shape=shapes.Box(lower=(0.6, 0.2), upper=(0.8, 0.4)),
                   material=materials.FixedCorotated(density=600, youngs_modulus=1e5))  # fmt: skip
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
    return scene


@pytest.fixture
def folder(tank, tmp_path):
    output = libmpm.Output(
        tmp_path / "run", frame_interval=0.02, attributes=["velocity", "pressure"]
    )
    with libmpm.Simulation(_small(tank), device="cpu", output=output) as simulation:
        simulation.run(until=0.1, progress=False)
    return tmp_path / "run"


def test_gif_has_a_picture_of_every_frame(folder, tmp_path):
    from PIL import Image

    frames = len(list((folder / "frames").glob("water_*.vtkhdf")))
    assert frames >= 5
    path = libmpm.animate(folder, tmp_path / "film.gif", colour="pressure", fps=10, dpi=40)
    assert path == tmp_path / "film.gif"
    with Image.open(path) as film:
        assert film.format == "GIF" and film.n_frames == frames
        assert film.info["duration"] == 100
        first = np.asarray(film.convert("RGB"), int)
        film.seek(frames - 1)
        last = np.asarray(film.convert("RGB"), int)
    assert np.count_nonzero(np.abs(first - last).sum(axis=2)) > 50, "something must have moved"
    half = libmpm.animate(folder, tmp_path / "half.gif", every=2, dpi=30, colour=None)
    with Image.open(half) as film:
        assert film.n_frames == -(-frames // 2)
    assert not list(tmp_path.glob(".*part*"))


def test_film_shows_the_frames_particles(folder):
    frames = films.RunFrames(folder, ["water", "block"], common.MOST)
    film = films._Film(frames, "xy", "speed", matplotlib.colors.Normalize(0, 1), 5.0)
    from libmpm._src.output.frames import read_frame

    for index in (frames.indices[0], frames.indices[-1]):
        film.show(index)
        for body in ("water", "block"):
            arrays, about = read_frame(folder / "frames" / f"{body}_{index:06d}.vtkhdf")
            shown = film._dots[body]
            np.testing.assert_allclose(
                np.sort(shown.get_offsets()[:, 1]), np.sort(arrays["position"][:, 1])
            )
            np.testing.assert_allclose(
                np.sort(shown.get_array()), np.sort(np.linalg.norm(arrays["velocity"], axis=1))
            )
        assert f"{about['time']:.3f} s" in film._axes.get_title(loc="left")
    few = films.RunFrames(folder, "water", 20)
    shown, count = few.dots(few.indices[0], "velocity_y")
    assert set(shown) == {"water"} and len(shown["water"]) <= 20 < count


def test_films_are_refused_by_name(folder, tmp_path, monkeypatch):
    for problem, arguments in (
        ("expected .gif, .mp4", {"path": tmp_path / "film.txt"}),
        ("colour is 'presure'.*'pressure'", {"path": tmp_path / "f.gif", "colour": "presure"}),
        ("plan.*'zz'", {"path": tmp_path / "f.gif", "plane": "zz"}),
        ("fps is 0", {"path": tmp_path / "f.gif", "fps": 0}),
        ("bodies has 'blok'", {"path": tmp_path / "f.gif", "bodies": ["blok"]}),
    ):
        with pytest.raises(libmpm.Error, match=problem):
            libmpm.animate(folder, **arguments)
    with pytest.raises(libmpm.Error, match=r"has no scene\.json"):
        libmpm.animate(tmp_path / "nowhere", tmp_path / "f.gif")
    monkeypatch.setattr(matplotlib.animation.writers, "is_available", lambda name: False)
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(libmpm.Error, match=r"no program ffmpeg .* imageio-ffmpeg .*libmpm\[viz\]"):
        libmpm.animate(folder, tmp_path / "film.mp4")
    with pytest.raises(libmpm.OutputError, match="cannot write"):
        libmpm.animate(folder, tmp_path / "no" / "such" / "film.gif", dpi=30)


def test_mp4_has_a_picture_of_every_frame(folder, tmp_path):
    if not matplotlib.animation.writers.is_available("ffmpeg"):
        pytest.importorskip("imageio_ffmpeg")
    path = libmpm.animate(folder, tmp_path / "film.mp4", fps=12, dpi=50)
    content = path.read_bytes()
    assert content[4:8] == b"ftyp"
    # The sample sizes box says how many pictures a track has.
    place = content.index(b"stsz")
    assert int.from_bytes(content[place + 12 : place + 16], "big") == len(
        list((folder / "frames").glob("water_*.vtkhdf"))
    )


# Tables and progress ------------------------------------------------------------------------


def cells_of(text):
    return re.findall(r"<t[dh]>(.*?)</t[dh]>", text)


def test_tables_escape_and_compute_nothing(tank, monkeypatch):
    scene = _small(tank)
    named = json.loads(json.dumps(scene.to_dict()))
    named["name"] = "<script>alert(1)<!-- -->"
    scene = libmpm.Scene.from_dict(named)
    text = scene._repr_html_()
    assert "<script" not in text and "&lt;script&gt;" in text
    assert {"water", "TaitFluid", "block", "FixedCorotated", "walls", "Slip"} <= set(cells_of(text))
    simulation = libmpm.Simulation(scene, device="cpu")
    text = simulation._repr_html_()
    assert simulation._assembly.made is None, "a table must not make an engine"
    assert "<script" not in text and "0 s, step 0" in cells_of(text)
    assert {"water", "TaitFluid"} <= set(cells_of(simulation.particles._repr_html_()))
    assert "water" in cells_of(simulation.particles["water"]._repr_html_())
    assert "velocity" in simulation.grid._repr_html_()
    assert "water" in repr(simulation.particles) and "velocity" in repr(simulation.grid)
    assert repr(simulation.sensors).startswith("<series of ")
    assert simulation._assembly.made is None, "nor may a text"
    simulation.step(3)
    asked = []
    engine = simulation._assembly.made

    class Watched:
        def __getattr__(self, name):
            asked.append(name)
            return getattr(engine, name)

    simulation._assembly.made = Watched()
    assert "step 3" in simulation._repr_html_()
    assert set(asked) <= {"time", "step"}, "these are numbers that the host has"
    assert set(cells_of(scene.plan(device="cpu")._repr_html_())) >= {"water", "block"}


def test_series_show_their_ends():
    from libmpm._src.output.series import Series

    series = Series("a<b", tuple(f"c{k}" for k in range(10)), ("m",) * 10)
    assert "0 samples" in series._repr_html_()
    series.append(np.arange(100.0), np.arange(1000.0).reshape(100, 10))
    text = series._repr_html_()
    cells = cells_of(text)
    assert "a&lt;b" in text and "100 samples" in text
    assert {"0", "1", "2", "97", "98", "99", "990", "… 2 more"} <= set(cells)
    assert "50" not in cells and len(text) < 5000
    assert html_table([["x" * 1000]]).count("x") < 200


def test_sensors_are_listed_without_samples(scene):
    simulation = libmpm.Simulation(scene, device="cpu")
    cells = cells_of(simulation.sensors._repr_html_())
    assert {"gauge", "WaveGauge", "load", "LoadCell"} <= set(cells)
    assert simulation._assembly.made is None


def test_progress_tells_pace_and_remaining_time(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(progress.clock, "monotonic", lambda: now[0])
    seen = []
    report = progress.reporter(seen.append, 1.0, 5.0, "x")
    for k in range(1, 101):
        now[0] += 1.0
        # A second of simulation takes 10 s at first and 50 s after half a minute.
        simulated = 1.0 + (0.1 * k if k <= 30 else 3.0 + 0.02 * (k - 30))
        report.update(progress.State(simulated, 5.0, k, 1e6))
    assert math.isclose(seen[9].pace, 0.1) and math.isclose(seen[9].remaining, 30.0)
    assert math.isclose(seen[9].elapsed, 10.0)
    # A window of 30 s has forgotten the fast beginning.
    assert math.isclose(seen[69].pace, 0.02, rel_tol=1e-9)
    assert math.isclose(seen[69].remaining, (5.0 - seen[69].time) / 0.02)
    assert progress.State(5.0, 5.0, 1, 0.0).remaining == 0.0
    assert math.isnan(progress.State(1.0, 5.0, 1, 0.0).remaining)
    assert [progress.duration(x) for x in (3.2, 75, 3725, math.nan)] == [
        "0:03", "1:15", "1:02:05", "?",
    ]  # fmt: skip


def test_progress_line_shows_rate_and_remaining_time(monkeypatch, capsys):
    now = [0.0]
    monkeypatch.setattr(progress.clock, "monotonic", lambda: now[0])
    bar = progress.reporter(True, 0.0, 2.0, "surge")
    now[0] = 30.0
    bar.update(progress.State(0.5, 2.0, 100, 3.25e6))
    bar.close()
    line = capsys.readouterr().err.split("\r")[-1]
    assert "surge" in line and "25%" in line and "0.500/2.000 s" in line
    assert "1:30 left" in line and "1.67e-02 s/s" in line and "3.25e+06 particle-steps/s" in line


def test_pictures_are_loaded_when_they_are_used():
    """A run on a cluster pays nothing for pictures that it does not make."""
    package = Path(importlib.import_module("libmpm").__file__).parent
    for path in package.rglob("*.py"):
        if "pictures" in path.parts or path.name == "__init__.py":
            continue
        for line in path.read_text(encoding="utf-8").splitlines():
            assert not re.match(r"(from|import) .*(_src\.pictures|pyvista)", line), path
