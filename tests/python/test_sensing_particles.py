"""Attributes by library name, sensors of particles, functions of one's own, refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest

import libmpm
from libmpm import materials, sensors, shapes
from libmpm._src.sensors import attributes
from support.sensing_scenes import (
    SOLID,
    WATER,
    G,
    add_block,
    add_walls,
    busy_scene,
    height,
    open_scene,
    same,
    simulate,
)

# Particles ----------------------------------------------------------------------------------------


def strained():
    """Return a 3D block in motion, and its tensors in NumPy."""
    scene = open_scene(dimension=3, gravity=0.0)
    flow = ("0.9 * x - 0.6 * y + 0.2 * z", "0.7 * x * y + 0.4 * z", "-1.5 * z + 0.3 * x")
    scene.add_body(
        name="block",
        shape=shapes.Box(lower=(0.6,) * 3, upper=(1.2,) * 3),
        material=materials.FixedCorotated(**SOLID),
        velocity=libmpm.Field(components=flow),
    )
    sim = simulate(scene)
    sim.step(60)
    return sim


def test_every_attribute_is_what_numpy_makes_of_the_engines():
    sim = strained()
    view = sim.particles["block"]
    f, cauchy, ratio = view["deformation_gradient"], view["stress"], view["volume_ratio"]
    assert np.abs(f - np.eye(3)).max() > 0.02
    got = view.read(
        [
            n
            for n in attributes.names()
            if n not in ("PorePressure", "logJp") and not attributes.of_elements(n)
        ]
    )
    want = {}
    for p in (0, 77, len(f) - 1):
        inverse = np.linalg.inv(f[p])
        first = ratio[p] * cauchy[p] @ inverse.T
        u, stretch, _ = np.linalg.svd(f[p])
        small = 0.5 * (f[p] + f[p].T) - np.eye(3)
        tensors = {"DefGrad": f[p], "StressCauchy": cauchy[p], "StressPK1": first,
                   "StressPK2": inverse @ first, "StrainSmall": small}  # fmt: skip
        for name, a in tensors.items():
            for i in range(3):
                for j in range(3):
                    want[f"{name}_{'XYZ'[i]}{'XYZ'[j]}"] = a[i, j]
            want[f"{name}_Invariant1"] = np.trace(a)
            want[f"{name}_Invariant2"] = sum(
                a[i, i] * a[j, j] - a[i, j] * a[j, i] for i, j in ((0, 1), (0, 2), (1, 2))
            )
            want[f"{name}_Invariant3"] = np.linalg.det(a)
        # Isotropic elasticity: principal stresses belong to the principal stretches.
        kirchhoff = np.diag(u.T @ (ratio[p] * cauchy[p]) @ u)
        values = {"DefGrad": stretch, "StressCauchy": np.linalg.eigvalsh(cauchy[p])[::-1],
                  "StressPK1": np.sort(kirchhoff / stretch)[::-1],
                  "StressPK2": np.sort(kirchhoff / stretch**2)[::-1],
                  "StrainSmall": np.linalg.eigvalsh(small)[::-1]}  # fmt: skip
        for name, three in values.items():
            want |= {f"{name}_{k + 1}": three[k] for k in range(3)}
        s1, s2, s3 = np.linalg.eigvalsh(cauchy[p])
        e1, e2, e3 = np.linalg.eigvalsh(small)
        x = view["position"][p]
        velocity = view["velocity"][p]
        want |= {
            "VonMisesStress": math.sqrt(0.5 * ((s1 - s2) ** 2 + (s2 - s3) ** 2 + (s3 - s1) ** 2)),
            "VonMisesStrain": math.sqrt(2 / 9 * ((e1 - e2) ** 2 + (e2 - e3) ** 2 + (e3 - e1) ** 2)),
            "Dilation": np.trace(small), "StrainSmall_Determinant": np.linalg.det(small),
            "J": np.linalg.det(f[p]), "JBar": ratio[p], "DefGrad_Determinant": ratio[p],
            "DefGrad_Determinant_FBAR": ratio[p], "Pressure": -np.trace(cauchy[p]) / 3,
            "ID": view["id"][p], "Mass": view["mass"][p], "Volume": view["volume"][p],
            "Velocity_Magnitude": np.linalg.norm(velocity), "Elevation": x[2],
            **{f"Position_{a}": v for a, v in zip("XYZ", x, strict=True)},
            **{f"Velocity_{a}": v for a, v in zip("XYZ", velocity, strict=True)},
        }  # fmt: skip
        assert set(want) == set(got)
        for name, value in want.items():
            scale = 1e5 if name.startswith("Stress") else 1.0
            power = 3 if name.endswith("Invariant3") else 2 if name.endswith("Invariant2") else 1
            bound = 1e-11 * scale**power
            assert got[name][p] == pytest.approx(value, rel=1e-9, abs=bound), name


def test_the_library_has_all_names():
    of_elements = [n for n in attributes.names() if attributes.of_elements(n)]
    assert len(attributes.names()) - len(of_elements) == 96 + 1  # with "Elevation"
    assert len(of_elements) == 1 + 3 + 6  # von Mises, principal stresses, components
    for name in ("StressPK2_ZX", "StrainSmall_Invariant3", "DefGrad_3", "logJp", "PorePressure"):
        assert attributes.find(name) is not None


def test_plane_strain_has_its_third_stress():
    scene = open_scene(gravity=0.0)
    flow = libmpm.Field(components=("-2 * (x - 0.8)", "0.5 * y"))
    linear = materials.LinearElastic(density=500.0, youngs_modulus=1e5, poissons_ratio=0.3)
    add_block(scene, velocity=flow)
    box = {"lower": (1.4, 0.5), "upper": (1.8, 0.9)}
    add_block(scene, name="linear", velocity=flow, material=linear, **box)
    sim = simulate(scene)
    sim.step(20)
    block, other = sim.particles["block"], sim.particles["linear"]
    stress = block["stress"]
    lame = 1e5 * 0.3 / (1.3 * 0.4)
    np.testing.assert_allclose(block["StressCauchy_ZZ"], lame * (block["J"] - 1), rtol=1e-9)
    three = np.stack([stress[:, 0, 0], stress[:, 1, 1], block["StressCauchy_ZZ"]], axis=1)
    np.testing.assert_allclose(block["Pressure"], -three.mean(axis=1), rtol=1e-9)
    assert (block["DefGrad_ZZ"] == 1).all()
    # σ J = λ tr ε + 2 G ε for the strain that a linear material stores.
    shear, ratio = 1e5 / 2.6, other["J"]
    for one in ("XX", "YY", "XY"):
        strain = other[f"StrainSmall_{one}"]
        want = 2 * shear * strain + (lame * other["Dilation"] if one != "XY" else 0)
        np.testing.assert_allclose(ratio * other[f"StressCauchy_{one}"], want, atol=1e-7)


def test_plastic_volumes_are_those_that_materials_store():
    scene = open_scene(gravity=0.0)
    elastic = {"density": 1500.0, "youngs_modulus": 1e5, "poissons_ratio": 0.3}
    sand = materials.DruckerPrager(**elastic, friction_angle=30.0)
    apart = libmpm.Field(components=("3 * (x - 0.8)", "0"))
    add_block(scene, name="sand", velocity=apart, material=sand)
    clay = materials.CamClay(**elastic, log_plastic_volume=-0.01)
    together = libmpm.Field(components=("-3 * (x - 1.6)", "-3 * (y - 0.7)"))
    box = {"lower": (1.4, 0.5), "upper": (1.8, 0.9)}
    add_block(scene, name="clay", velocity=together, material=clay, **box)
    sim = simulate(scene)
    start = sim.particles["clay"]["logJp"]
    sim.step(20)
    # Pulled sand opens without stress: all of its volume is gap.
    view = sim.particles["sand"]
    opened = view["logJp"] > 1e-4
    assert opened.any()
    np.testing.assert_allclose(view["logJp"][opened], np.log(view["J"][opened]), rtol=1e-3)
    assert (start == -0.01).all()
    assert sim.particles["clay"]["logJp"].min() < -0.02
    # Where the columns lie: in clay J = J_e times what is gained, and p J = -K (J_e² - 1) / 2.
    view = sim.particles["clay"]
    stretched = 1 - 2 * view["Pressure"] * view["J"] * 3 * (1 - 0.6) / 1e5
    gained = np.log(view["J"]) - 0.5 * np.log(stretched)
    assert np.abs(gained).max() > 0.01
    state = sim.engine.attributes(1, ["id", "state"])
    arrays = {"state": state["state"][np.argsort(state["id"])]}
    source = attributes.Source(arrays, scene.bodies[1], np.array([0.0, 1.0]))
    np.testing.assert_allclose(source.column("dilation"), gained, atol=1e-9)
    np.testing.assert_array_equal(view["logJp"], source.column("consolidation") - 0.01)


def test_frames_take_library_names(tmp_path):
    import h5py

    scene = open_scene()
    add_block(scene)
    names = ["DefGrad_XX", "StressCauchy_1", "velocity"]
    output = libmpm.Output(tmp_path / "run", frame_interval=0.01, attributes=names)
    sim = simulate(scene, 0.01, output=output)
    sim.close()
    frame = sorted((tmp_path / "run" / "frames").glob("*.vtkhdf"))[-1]
    with h5py.File(frame) as file:
        data = file["VTKHDF/PointData"]
        assert set(names) <= set(data)
        np.testing.assert_array_equal(data["DefGrad_XX"][:], sim.particles["block"]["DefGrad_XX"])
    wrong = libmpm.Output(tmp_path / "wrong", frame_interval=0.01, attributes=["PorePressure"])
    with pytest.raises(libmpm.SceneError, match=r"'PorePressure'.*no pore pressure"):
        simulate(scene, 0.01, output=wrong)


def test_particles_are_reduced_with_regions_and_directions():
    scene = busy_scene()
    region = shapes.Box(lower=(0.0, 0.2), upper=(1.0, 0.7))
    asked = {
        "pressure": sensors.ParticleSensor(attribute="Pressure", region=region),
        "count": sensors.ParticleSensor(attribute="Mass", operation="count", region=region),
        "down": sensors.ParticleSensor(
            attribute="velocity", operation="std", direction="y-", region=region, body="water"
        ),
        "far": sensors.ParticleSensor(
            attribute="Mass", region=shapes.Box(lower=(1.8, 1.8), upper=(2, 2))
        ),
    }
    for name, sensor in asked.items():
        scene.add_sensor(name=name, sensor=sensor)
    sim = simulate(scene)
    sim.step(40)
    inside, read = {}, {}
    for name, view in sim.particles.items():
        x = view["position"] - np.array(scene.origin)
        inside[name] = (x[:, 0] <= 1) & (x[:, 1] >= 0.2) & (x[:, 1] <= 0.7)
        read[name] = view.read(["pressure", "velocity"])
    pressure = np.concatenate([read[n]["pressure"][inside[n]] for n in read])
    down = read["water"]["velocity"][inside["water"], 1]
    last = {name: sim.sensors[name].values[-1] for name in asked}
    assert last["pressure"] == [pressure.max()]
    assert last["count"] == [len(pressure)]
    assert last["down"] == pytest.approx(down[down < 0].std())
    assert np.isnan(last["far"]).all()
    assert sim.sensors["down"].components == ("velocity_y_std",)
    ids = sim.sensors["ids"]
    assert ids.components[:3] == ("Pressure:7", "position_x:7", "position_y:7")


def test_a_tank_at_rest_shows_its_pressure_and_level():
    depth = 0.8
    scene = open_scene()
    scene.add_body(
        name="water",
        shape=shapes.Box(lower=(0, 0), upper=(2, depth)),
        material=materials.TaitFluid(**WATER),
        hydrostatic=depth,
    )
    add_walls(scene)
    places = {"middle": (1.0, 0.3), "wall": (0.0, 0.45), "floor": (0.7, 0.0), "corner": (2.0, 0.0)}
    for name, place in places.items():
        probe = sensors.PressureProbe(position=place, interval=0.01)
        scene.add_sensor(name=name, sensor=probe)
    mean = sensors.PressureProbe(position=places["middle"], order=0, interval=0.01)
    scene.add_sensor(name="mean", sensor=mean)
    scene.add_sensor(name="dry", sensor=sensors.PressureProbe(position=(1.0, 1.5), interval=0.01))
    gauges = {
        "highest": sensors.ElevationGauge(position=(1.0,), interval=0.01),
        "half": sensors.ElevationGauge(
            position=(1.0,), method="percentile", percentile=50, interval=0.01
        ),
        "outside": sensors.ElevationGauge(position=(1.0,), interval=0.01, radius=1e-6),
    }
    for name, gauge in gauges.items():
        scene.add_sensor(name=name, sensor=gauge)
    sim = simulate(scene, 0.1)
    for name, place in places.items():
        want = 1000 * G * (depth - place[1])
        assert sim.sensors[name].values[:, 0] == pytest.approx(want, rel=0.03), name
    assert sim.sensors["mean"].values[:, 0] == pytest.approx(1000 * G * 0.5, rel=0.03)
    assert np.isnan(sim.sensors["dry"].values).all()
    assert sim.sensors["highest"].values[:, 0] == pytest.approx(10 + depth, abs=0.01)
    assert sim.sensors["half"].values[:, 0] == pytest.approx(10 + depth / 2, abs=0.05)
    assert np.isnan(sim.sensors["outside"].values).all()


# Functions of one's own ---------------------------------------------------------------------------


def with_custom(function=height):
    scene = open_scene()
    add_block(scene)
    custom = sensors.Custom(function=function, columns=("top",), units=("m",), interval=0.01)
    scene.add_sensor(name="mine", sensor=custom)
    return scene


def test_a_function_samples_and_its_run_resumes(tmp_path):
    whole = simulate(with_custom(), 0.1)
    assert whole.sensors["mine"].values[0, 0] == pytest.approx(10.875)
    assert (np.diff(whole.sensors["mine"].values[:, 0]) < 0).all()
    part = simulate(with_custom(), 0.05, output=tmp_path / "run")
    part.save_checkpoint(tmp_path / "state.npz")
    resume = libmpm.Simulation.resume
    # A checkpoint can be read without the function; it is needed where the run goes on.
    with pytest.raises(libmpm.SceneError, match=r"'mine'.*sensing_scenes:height.*functions="):
        resume(tmp_path / "state.npz").step()
    resumed = resume(tmp_path / "state.npz", functions={"mine": height})
    resumed.run(until=0.1, progress=False)
    same(whole, resumed)
    with pytest.raises(libmpm.SceneError, match="functions has 'nobody'"):
        resume(tmp_path / "state.npz", functions={"nobody": height})


def test_a_function_cannot_be_saved_or_step_or_miscount(tmp_path):
    with pytest.raises(libmpm.SceneError, match=r"'mine'.*height.*add it where the scene is run"):
        with_custom().save(tmp_path / "scene.json")
    assert not (tmp_path / "scene.json").exists()
    with pytest.raises(libmpm.SceneError, match=r"'mine'.*expected 1 numbers"):
        simulate(with_custom(lambda sim: (1.0, 2.0)), 0.01)
    with pytest.raises(libmpm.SceneError, match="advances the simulation"):
        simulate(with_custom(lambda sim: sim.step()), 0.01)


# Refusals -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("sensor", "says"),
    [
        (
            sensors.ParticleSensor(attribute="StressPK1_XX"),
            "attribute is 'StressPK1_XX' of body 'water'.*TaitFluid stores no deformation "
            "gradient; bodies that do: 'block'; ask for it of 'block'",
        ),
        (
            sensors.ParticleSensor(attribute="PorePressure", body="block"),
            "no pore pressure; bodies",
        ),
        (sensors.ParticleSensor(attribute="logJp", body="block"), "stores no logarithm"),
        (sensors.ParticleSensor(attribute="Presure"), "did you mean 'Pressure'"),
        (sensors.ParticleSensor(attribute="Position_Z"), "'Position_Z' in 2D"),
        (sensors.ParticleSensor(attribute="Pressure", direction="x"), "a single number"),
        (sensors.ParticleSensor(attribute="velocity", direction="z"), "direction is 'z' in 2D"),
        (sensors.ParticleSensor(attribute="plastic_strain", body="block"), "does not store it"),
        (sensors.BodyTracker(body="blok"), "body 'blok' is unknown"),
        (sensors.AttributeTracker(body="water", ids=(9999,), attributes="J"), "ids has 9999"),
        (sensors.PressureProbe(position=(3.0, 0.1)), "the probe is at 3 m on axis 0"),
        (sensors.ElevationGauge(position=(1.0, 1.0)), "position has 2 numbers; expected 1"),
        (
            sensors.GridSensor(region=shapes.Box(lower=(0, 0, 0), upper=(1, 1, 1))),
            "region has 3 dimensions; expected 2",
        ),
    ],
)
def test_what_cannot_be_measured_is_refused(sensor, says):
    scene = busy_scene()
    scene.add_sensor(name="wrong", sensor=sensor)
    with pytest.raises(libmpm.SceneError, match=f"sensor 'wrong': .*{says}"):
        scene.validate()


def test_forces_of_filtered_grids_are_refused():
    scene = open_scene(transfer=libmpm.methods.Transfer(scheme="XPIC"))
    add_block(scene)
    scene.add_sensor(name="force", sensor=sensors.GridSensor(attribute="force"))
    with pytest.raises(libmpm.SceneError, match=r"'force'.*XPIC.*use a LoadCell"):
        scene.validate()


def test_wrong_values_are_refused_when_made():
    with pytest.raises(libmpm.SceneError, match="direction is 'x' of 'mass'"):
        sensors.GridSensor(attribute="mass", direction="x")
    with pytest.raises(libmpm.SceneError, match="percentile is None"):
        sensors.ElevationGauge(position=(1.0,), method="percentile")
    with pytest.raises(libmpm.SceneError, match="more than once"):
        sensors.BodyTracker(body="b", quantities=("extent", "extent"))
    with pytest.raises(KeyError, match=r"StressPK1_XX.*stores no deformation gradient"):
        _ = simulate(busy_scene()).particles["water"]["StressPK1_XX"]
