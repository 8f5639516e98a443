"""Particles as arrays of other libraries, and arrays of other libraries as particles.

Expected duration: 2 s.
"""

import contextlib
import ctypes
import gc
import threading
import time
import warnings
import weakref

import numpy as np
import pytest

import libmpm
from libmpm._src.base.arrays import host_array

#: Derived by the host; all others are gathered where the particles are.
DERIVED = {"pressure", "stress", "elastic_energy", "density", "volume"}


def simulation(new_scene, precision="double", device="cpu", **changes):
    with quiet():
        return libmpm.Simulation(new_scene(**changes), device=device, precision=precision)


@contextlib.contextmanager
def quiet():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", libmpm.ModelWarning)
        yield


class Stranger:
    """An array that nothing but DLPack can read, like those of other libraries."""

    def __init__(self, values, place=(1, 0)):
        self._values = np.ascontiguousarray(values)
        self._place = place

    def __dlpack__(self, **given):
        if self._place[0] != 1:
            raise BufferError("this one stays on its device")
        return self._values.__dlpack__(**given)

    def __dlpack_device__(self):
        return self._place


@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize("body", ["water", "block"])
def test_arrays_are_what_the_views_show(new_scene, precision, body):
    run = simulation(new_scene, precision)
    run.step(15)
    shown = run.particles[body]
    with run.device_arrays(body, "id", "position", "velocity") as arrays:
        assert set(arrays) == set(shown.names)
        for name in arrays:
            taken = np.from_dlpack(arrays[name])
            expected = shown[name]
            assert taken.dtype == expected.dtype and taken.shape == expected.shape
            # The same sums in the same order in double precision; a compiler may fuse one of them.
            scale = max(1.0, float(np.abs(expected.astype(float)).max()))
            assert np.abs(taken.astype(float) - expected).max() <= 4e-16 * scale, name
        assert np.from_dlpack(arrays.id)[0] == shown["id"][0]


def test_origin_is_in_positions(new_scene):
    run = simulation(new_scene, origin=(1e5, -2e4, 30.0))
    with run.device_arrays("water") as arrays:
        here = np.from_dlpack(arrays.position)
    np.testing.assert_array_equal(here, run.particles["water"]["position"])
    assert here.min(axis=0)[0] > 1e5


def test_interfaces_describe_one_memory(new_scene):
    run = simulation(new_scene)
    with run.device_arrays("water") as arrays:
        x = arrays.position
        assert x.__dlpack_device__() == (1, 0) and x.device == "cpu" and x.unit == "m"
        view, taken = np.asarray(x), np.from_dlpack(x)
        assert np.shares_memory(view, taken)
        assert x.__array_interface__["data"][0] == view.ctypes.data
        assert not hasattr(x, "__cuda_array_interface__")
        copied = np.from_dlpack(x, copy=True)
        assert not np.shares_memory(copied, taken)
        np.testing.assert_array_equal(copied, taken)
        # What is handed over belongs to whoever takes it: writing changes nothing of the run.
        before = run.particles["water"]["position"]
        taken[:] = 0
        np.testing.assert_array_equal(run.particles["water"]["position"], before)
        with pytest.raises(BufferError, match="stream is 7"):
            x.__dlpack__(stream=7)
        with pytest.raises(BufferError, match=r"dl_device is \(2, 0\)"):
            x.__dlpack__(dl_device=(2, 0), max_version=(1, 0))


def name_of(capsule):
    get = ctypes.pythonapi.PyCapsule_GetName
    get.restype, get.argtypes = ctypes.c_char_p, [ctypes.py_object]
    return get(capsule)


def test_capsules_follow_the_version_that_is_asked_for(new_scene):
    run = simulation(new_scene)
    with run.device_arrays("block") as arrays:
        x = arrays.velocity
        assert name_of(x.__dlpack__()) == b"dltensor"
        assert name_of(x.__dlpack__(max_version=(0, 8))) == b"dltensor"
        assert name_of(x.__dlpack__(max_version=(1, 1))) == b"dltensor_versioned"
        # Capsules that nobody takes free what they hold; NumPy renames those that it takes.
        for version in ((0, 8), (1, 0)):
            for _ in range(50):
                x.__dlpack__(max_version=version)
            capsule = x.__dlpack__(max_version=version)
            holder = type("", (), {"__dlpack__": lambda s, c=capsule, **k: c,
                                   "__dlpack_device__": lambda s: (1, 0)})()  # fmt: skip
            np.testing.assert_array_equal(
                np.from_dlpack(holder), run.particles["block"]["velocity"]
            )
            assert name_of(capsule).startswith(b"used_dltensor")


def test_arrays_outlive_the_simulation(new_scene):
    run = simulation(new_scene)
    run.step(2)
    expected = run.particles["water"]["velocity"]
    with run.device_arrays("water") as arrays:
        taken, seen = np.from_dlpack(arrays.velocity), np.asarray(arrays["velocity"])
    run.close()
    del run, arrays
    gc.collect()
    np.testing.assert_array_equal(taken, expected)
    np.testing.assert_array_equal(seen, expected)


def test_memory_goes_back_without_the_collector(new_scene):
    run = simulation(new_scene)
    gc.disable()
    try:
        with run.device_arrays("water", "position") as arrays:
            left = weakref.ref(arrays.position)
            kept = np.asarray(arrays.position)
        del arrays
        assert left() is not None, "NumPy's view holds it"
        del kept
        assert left() is None
    finally:
        gc.enable()


def test_memory_is_let_go_while_the_engine_works(new_scene):
    run, alone = (simulation(new_scene) for _ in range(2))
    with run.device_arrays("water") as arrays:
        taken = [np.from_dlpack(arrays.position, copy=True) for _ in range(40)]
    del arrays
    stepping = threading.Thread(target=run.step, args=(40,))
    stepping.start()
    while taken:
        taken.pop()
        time.sleep(1e-3)
    stepping.join()
    alone.step(40)
    assert run.steps == 40
    np.testing.assert_array_equal(
        run.particles["water"]["position"], alone.particles["water"]["position"]
    )


def test_stale_arrays_are_refused_by_name(new_scene, tmp_path):
    run = simulation(new_scene)
    run.step(1)
    run.save_checkpoint(tmp_path / "state.npz")
    with run.device_arrays("water") as arrays:
        speed = arrays.speed
        kept = np.from_dlpack(speed)
        before = kept.copy()
        run.step(1)
        for use in (speed.__dlpack__, lambda: speed.__array_interface__, speed.to_numpy,
                    lambda: np.asarray(speed), lambda: arrays["position"]):  # fmt: skip
            with pytest.raises(libmpm.Error, match=r"generation 1, .* generation 2, .* take it"):
                use()
    # What was taken before is a copy and stays.
    np.testing.assert_array_equal(kept, before)
    with run.device_arrays("water") as arrays:
        speed = arrays.speed
        run.step(0)
        speed.to_numpy()  # nothing has moved
    with pytest.raises(libmpm.Error, match="'speed' of body 'water' is used outside"):
        speed.to_numpy()
    with pytest.raises(libmpm.Error, match="outside"):
        run.device_arrays("water")["position"]


def test_unknown_names_are_refused(new_scene):
    run = simulation(new_scene)
    with pytest.raises(KeyError, match="no body 'watr'; did you mean 'water'"):
        run.device_arrays("watr")
    with pytest.raises(KeyError, match="no attribute 'positon'"):
        run.device_arrays("water", "positon")
    with run.device_arrays("water") as arrays:
        assert not hasattr(arrays, "colour")


@pytest.mark.parametrize("leaving", ["delete", "freeze"])
def test_rows_of_bodies_that_are_stepped_as_one(tank, leaving):
    scene = tank(method=libmpm.Method(leaving=leaving))
    for k in range(3):
        scene.add_body(
            name=f"block-{k}",
            shape=libmpm.shapes.Box(lower=(0.1 + 0.3 * k, 0.6), upper=(0.3 + 0.3 * k, 0.8)),
            material=libmpm.materials.FixedCorotated(density=900.0, youngs_modulus=1e5),
            velocity=(0.0, -4.0 if k == 1 else 0.0),
        )
    with quiet():
        run = libmpm.Simulation(scene, device="cpu", precision="double")
        run.run(until=0.21, progress=False)
    counts = [run.particle_count(k) for k in range(3)]
    lowest = run.particles["block-1"]["position"][:, 1].min()
    gone = 0 < counts[1] < counts[0] if leaving == "delete" else lowest < 0
    assert gone, "particles of the second block must have left for this to mean anything"
    for name in run.particles:
        with run.device_arrays(name, "id", "position", "velocity") as arrays:
            for field in ("id", "position", "velocity"):
                expected = run.particles[name][field]
                assert np.from_dlpack(arrays[field]).shape == expected.shape
                np.testing.assert_allclose(
                    np.from_dlpack(arrays[field]), expected, rtol=0, atol=1e-14
                )


def test_rows_of_a_body_that_an_inlet_fills():
    """Its ids have room for billions; a gather takes memory for those in use alone."""
    scene = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(1.2, 0.5),
                         gravity=(0, -9.81))  # fmt: skip
    scene.add_body(
        name="water",
        shape=libmpm.shapes.Box(lower=(0, 0), upper=(1.2, 0.3)),
        material=libmpm.materials.TaitFluid(bulk_modulus=1e5),
        velocity=(1.0, 0.0),
        hydrostatic=0.3,
    )
    scene.add_boundary(name="bed", shape=libmpm.shapes.DomainWalls(faces=("y-",)),
                       response=libmpm.boundaries.Slip())  # fmt: skip
    inflow = libmpm.boundaries.Inflow(body="water", face="x-", velocity=1.0, level=0.3)
    scene.add_flow(name="in", flow=inflow)
    scene.add_flow(name="out", flow=libmpm.boundaries.Outflow(face="x+", velocity=1.0))
    with quiet():
        run = libmpm.Simulation(scene, device="cpu")
        run.run(until=0.3, progress=False)
    shown = run.particles["water"]
    assert shown["id"].max() >= len(shown), "some must have come and some gone"
    with run.device_arrays("water", "id", "position", "velocity") as arrays:
        for name in ("id", "position", "velocity", "pressure"):
            np.testing.assert_allclose(
                np.from_dlpack(arrays[name]), shown[name], rtol=0, atol=1e-14
            )


def test_arrays_on_a_grid_of_functions():
    mesh = libmpm.grids.Mesh.blocks(columns=4, rows=4, lower=(0.0, 0.0), upper=(1.0, 1.0))
    scene = libmpm.Scene(grid=libmpm.grids.TriangularGrid(mesh=mesh), gravity=(0.0, -9.81))
    scene.add_body(
        name="block",
        shape=libmpm.shapes.Box(lower=(0.3, 0.4), upper=(0.7, 0.8)),
        material=libmpm.materials.LinearElastic(density=900.0, youngs_modulus=1e5),
    )
    with quiet():
        run = libmpm.Simulation(scene, device="cpu")
        run.particles["block"]["velocity"] = np.full((run.particle_count(0), 2), 0.25)
        run.step(3)
    shown = run.particles["block"]
    assert shown["velocity"][:, 0] == pytest.approx(0.25, rel=1e-9)
    with run.device_arrays("block") as arrays:
        for name in arrays:
            np.testing.assert_array_equal(np.from_dlpack(arrays[name]), shown[name])


def test_looking_does_not_change_the_bits(new_scene):
    looked, left = (simulation(new_scene, "single") for _ in range(2))
    for _ in range(4):
        looked.step(5)
        with looked.device_arrays("water", "position", "speed") as arrays:
            np.from_dlpack(arrays.position)[:] = 7.0
        with looked.device_arrays("block") as arrays:
            arrays.stress.to_numpy()
    left.step(20)
    a, b = looked.engine.save(), left.engine.save()
    assert a.keys() == b.keys()
    for key in a:
        assert np.array_equal(a[key], b[key], equal_nan=a[key].dtype.kind == "f"), key


def pool(tank, **changes):
    """Water that fills a tank but for a margin, at rest and without weight."""
    scene = tank(upper=(2.0, 2.0), gravity=(0.0, 0.0), **changes)
    scene.add_body(
        name="water",
        shape=libmpm.shapes.Box(lower=(0.2, 0.2), upper=(1.8, 1.8)),
        material=libmpm.materials.TaitFluid(bulk_modulus=1e6),
    )
    return scene


def test_initial_velocities_of_any_library_are_taken(tank, tmp_path):
    with quiet():
        run = libmpm.Simulation(pool(tank), device="cpu", precision="double",
                                output=tmp_path / "run")  # fmt: skip
    position, mass = (run.particles["water"][n] for n in ("position", "mass"))
    given = np.stack([0.3 * position[:, 1], 0.5 - 0.1 * position[:, 0]], axis=1)
    run.particles["water"]["velocity"] = Stranger(given)
    # Linear fields go to the grid and back exactly, three cells from the surface on.
    inside = np.all((position > 0.55) & (position < 1.45), axis=1)
    assert inside.sum() > 100
    assert np.abs(run.particles["water"]["velocity"] - given)[inside].max() < 1e-13
    momentum = (mass[:, None] * given).sum(axis=0)
    on_grid = (run.grid["mass"][:, None] * run.grid["velocity"]).sum(axis=0)
    assert on_grid == pytest.approx(momentum, rel=1e-13)
    run.step(20)
    on_grid = (run.grid["mass"][:, None] * run.grid["velocity"]).sum(axis=0)
    assert on_grid == pytest.approx(momentum, rel=1e-11)
    run.close()
    # The scene file does not hold it; the run's folder does.
    with np.load(tmp_path / "run" / "initial.npz") as saved:
        assert saved.files == ["water/velocity"]
        np.testing.assert_array_equal(saved["water/velocity"], given)


def test_initial_velocities_go_on_from_checkpoints(tank, tmp_path):
    scene = pool(tank)
    with quiet():
        whole = libmpm.Simulation(scene, device="cpu")
        count = whole.particle_count(0)
        whole.particles["water"]["velocity"] = np.linspace(0, 1, 2 * count).reshape(count, 2)
        whole.step(5)
        whole.save_checkpoint(tmp_path / "state.npz")
        whole.step(5)
        resumed = libmpm.Simulation.resume(tmp_path / "state.npz")
        resumed.step(5)
    for name in ("position", "velocity"):
        np.testing.assert_array_equal(
            resumed.particles["water"][name], whole.particles["water"][name]
        )


def test_initial_pressure_sets_the_volume(tank):
    from libmpm._core import equation_of_state

    with quiet():
        run = libmpm.Simulation(pool(tank), device="cpu", precision="double")
    pressure = np.linspace(0.0, 5e3, run.particle_count(0))
    run.particles["water"]["pressure"] = pressure
    loss = 1 - run.particles["water"]["volume_ratio"]
    law = run.scene.bodies[0].material
    # What 1 - J loses to rounding, times the slope of the law.
    assert np.abs(equation_of_state(loss, law.bulk_modulus, law.exponent) - pressure).max() < (
        4 * np.finfo(float).eps * law.bulk_modulus
    )


def test_wrong_initial_states_are_refused(new_scene):
    run = simulation(new_scene)
    water, block = run.particles["water"], run.particles["block"]
    count = len(water)
    for view, name, array, rule in (
        (water, "velocity", np.zeros((3, 3)), rf"shape \(3, 3\); expected \({count}, 3\)"),
        (water, "velocity", np.full((count, 3), np.nan), r"velocity\[0\] is"),
        (water, "position", np.zeros((count, 3)), "'position' cannot be set"),
        (block, "pressure", np.zeros(len(block)), "FixedCorotated stores no volume ratio"),
        (water, "velocity", Stranger(np.zeros((count, 3)), (2, 0)), None),
    ):
        with pytest.raises(libmpm.Error if rule is None else libmpm.SceneError, match=rule):
            view[name] = array
    run.step(1)
    with pytest.raises(libmpm.SceneError, match="set at step 1"):
        water["velocity"] = np.zeros((count, 3))


def test_scenes_take_arrays_of_any_library(tank):
    table = libmpm.TimeTable(Stranger([0.0, 1.0]), Stranger([[0.0, 1.0], [2.0, 3.0]]))
    assert table == libmpm.TimeTable([0.0, 1.0], [[0.0, 1.0], [2.0, 3.0]])
    box = libmpm.shapes.Box(lower=Stranger([0.0, 0.0]), upper=(0.5, 0.5))
    assert box.lower == (0.0, 0.0)
    scene = tank(gravity=table)
    scene.add_body(name="w", shape=box, material=libmpm.materials.TaitFluid(),
                   velocity=Stranger([0.25, 0.0]))  # fmt: skip
    assert scene.bodies[0].velocity == (0.25, 0.0)
    assert libmpm.Scene.from_dict(scene.to_dict()) == scene
    with pytest.raises(libmpm.Error, match="Stranger cannot be brought to the host"):
        host_array(Stranger([1.0], (2, 0)), "velocity")


# On a device --------------------------------------------------------------------------------


def device_simulation(new_scene, precision="single"):
    return simulation(new_scene, precision, device="cuda")


@pytest.mark.gpu
@pytest.mark.parametrize("precision", ["single", "mixed", "double"])
@pytest.mark.parametrize("body", ["water", "block"])
def test_device_arrays_are_what_the_views_show(new_scene, precision, body):
    run = device_simulation(new_scene, precision)
    run.step(30)
    shown = run.particles[body]
    with run.device_arrays(body) as arrays:
        for name in arrays:
            x = arrays[name]
            assert x.__dlpack_device__() == (2, 0) and x.device == "cuda:0"
            assert not hasattr(x, "__array_interface__")
            expected = shown[name]
            got = x.to_numpy()
            assert got.dtype == expected.dtype and got.shape == expected.shape
            # Both are worked out in double precision; a device fuses products into sums.
            scale = max(1.0, float(np.abs(expected.astype(float)).max()))
            assert np.abs(got.astype(float) - expected).max() <= 1e-14 * scale, name
        with pytest.raises(TypeError, match="to_numpy"):
            np.asarray(arrays.position)
        host = np.from_dlpack(arrays.position, device="cpu")
        np.testing.assert_array_equal(host, arrays.position.to_numpy())
        with pytest.raises(BufferError, match="copy=False"):
            np.from_dlpack(arrays.position, device="cpu", copy=False)
        with pytest.raises(BufferError, match="stream is 0"):
            arrays.position.__dlpack__(stream=0)


@pytest.mark.gpu
@pytest.mark.parametrize("library", ["cupy", "torch"])
def test_device_arrays_in_libraries(new_scene, library):
    run = device_simulation(new_scene)
    run.step(10)
    xp = pytest.importorskip(library)
    expected = run.particles["water"]["position"]
    with run.device_arrays("water") as arrays:
        taken = xp.from_dlpack(arrays.position)
        interface = arrays.position.__cuda_array_interface__
        assert interface["version"] == 3 and interface["shape"] == expected.shape
        described = xp.asarray(arrays.position) if library == "cupy" else xp.as_tensor(
            arrays.position, device="cuda")  # fmt: skip
        ids = xp.from_dlpack(arrays.id)
        mean = float(xp.from_dlpack(arrays.speed).mean())

    def on_host(x):
        return x.get() if library == "cupy" else x.cpu().numpy()

    scale = np.abs(expected).max()
    assert np.abs(on_host(taken) - expected).max() <= 1e-14 * scale
    pointer = taken.data.ptr if library == "cupy" else taken.data_ptr()
    assert pointer == interface["data"][0], "one memory, no copy"
    np.testing.assert_array_equal(on_host(described), on_host(taken))
    np.testing.assert_array_equal(on_host(ids), run.particles["water"]["id"])
    assert mean == pytest.approx(run.particles["water"]["speed"].mean(), rel=1e-12)
    # Memory that another library holds stays while the run goes on.
    before = on_host(taken).copy()
    run.step(50)
    np.testing.assert_array_equal(on_host(taken), before)
    # And back: initial velocities from the device.
    other = device_simulation(new_scene)
    given = xp.zeros((len(before), 3), dtype=xp.float64)
    given = given + 0.25 if library == "cupy" else (given + 0.25).cuda()
    other.particles["water"]["velocity"] = given
    same = device_simulation(new_scene)
    same.particles["water"]["velocity"] = np.full((len(before), 3), 0.25)
    velocity = other.particles["water"]["velocity"]
    assert np.median(velocity[:, 0]) == pytest.approx(0.25, abs=0.01)
    np.testing.assert_array_equal(velocity, same.particles["water"]["velocity"])
    box = libmpm.shapes.Box(lower=given[0] * 0, upper=given[0] + 1)
    assert box.upper == (1.25, 1.25, 1.25)


@pytest.mark.gpu
def test_device_arrays_by_pointer_alone(new_scene):
    """Without any array library: what the CUDA array interface says is copied by the driver."""
    run = device_simulation(new_scene, "double")
    run.step(5)
    driver = ctypes.CDLL("libcuda.so.1")
    with run.device_arrays("block") as arrays:
        interface = arrays.position.__cuda_array_interface__
        host = np.empty(interface["shape"], interface["typestr"])
        pointer = ctypes.c_uint64(interface["data"][0])
        code = driver.cuMemcpyDtoH_v2(host.ctypes.data_as(ctypes.c_void_p), pointer,
                                      ctypes.c_size_t(host.nbytes))  # fmt: skip
    if code in (3, 201):  # no context is current in this thread
        pytest.skip(f"the driver has no context here: {code}")
    assert code == 0
    np.testing.assert_allclose(host, run.particles["block"]["position"], rtol=0, atol=1e-14)


@pytest.mark.gpu
def test_device_memory_goes_back(new_scene):
    run = device_simulation(new_scene)
    run.step(1)
    for _ in range(3):
        with run.device_arrays("water", "position", "velocity", "speed", "id") as arrays:
            capsules = [arrays[name].__dlpack__() for name in ("position", "id")]
        del capsules, arrays
    gc.collect()
    peak = run.statistics["most_bytes_used"]
    for _ in range(50):
        with run.device_arrays("water", "position", "velocity", "speed", "id"):
            pass
    assert run.statistics["most_bytes_used"] == peak
