"""ClaymoreUW scenes: own look-alikes of both dialects and of the HydroUQ wrapper."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, materials, shapes
from libmpm.compat import claymore

OWN = Path(__file__).parents[1] / "data" / "claymore"
GRAVITY = 9.80665

pytestmark = pytest.mark.filterwarnings("ignore::libmpm.ModelWarning")


@pytest.fixture
def edited(tmp_path: Path) -> Callable[..., Path]:
    """Return a function that writes a look-alike with changes, beside its motion file."""

    def write(name: str, change: Callable[[dict[str, Any]], object]) -> Path:
        data = json.loads((OWN / f"{name}.json").read_text())
        change(data)
        (tmp_path / "stroke.csv").write_text((OWN / "stroke.csv").read_text())
        path = tmp_path / f"{name}.json"
        path.write_text(json.dumps(data))
        return path

    return write


@pytest.fixture(scope="module")
def flume() -> claymore.Imported:
    """Return the look-alike of the current dialect."""
    return claymore.load(OWN / "flume.json")


@pytest.fixture(scope="module")
def models() -> claymore.Imported:
    """Return the look-alike of the first dialect."""
    return claymore.load(OWN / "models.json")


@pytest.fixture(scope="module")
def workflow() -> claymore.Imported:
    """Return the look-alike of a workflow file."""
    return claymore.load(OWN / "workflow.json")


def run_steps(scene: libmpm.Scene, steps: int) -> libmpm.Simulation:
    """Run a few steps on the CPU; every number of every particle must be finite."""
    sim = libmpm.Simulation(scene, device="cpu", precision="single")
    sim.step(steps)
    for body in sim.particles.values():
        for name in ("position", "velocity", "pressure"):
            assert np.all(np.isfinite(body[name]))
    return sim


def body_of(imported: claymore.Imported, name: str) -> Any:
    """Return a body by its name."""
    return next(b for b in imported.scene.bodies if b.name == name)


def boundary_of(imported: claymore.Imported, name: str) -> Any:
    """Return a boundary by its name."""
    return next(b for b in imported.scene.boundaries if b.name == name)


class TestCurrentDialect:
    """`bodies`, `boundaries`, `FBAR_psi`, `file`."""

    def test_head(self, flume: claymore.Imported) -> None:
        found = flume
        assert found.scene.cells == (60, 10, 4)
        assert found.scene.gravity == (0.0, -GRAVITY, 0.0)
        assert found.run.until == 2.0
        assert found.run.frame_interval == 0.05
        assert found.run.debris == ["debris-1", "debris-2"]
        assert found.run.attributes == {
            "water": ["pressure", "velocity", "volume_ratio"],
            "debris-1": ["VonMisesStress", "speed"],
            "debris-2": ["VonMisesStress", "speed"],
        }
        # The smallest CFL; default_dt is no bound here.
        assert found.scene.method.cfl == 0.3
        assert found.scene.method.time_step is None
        assert found.scene.transfer.scheme == "APIC"

    def test_water_fills_what_bed_and_paddle_leave(self, flume: claymore.Imported) -> None:
        found = flume
        water = body_of(found, "water")
        assert water.material == materials.TaitFluid(
            density=998, bulk_modulus=2e6, exponent=7.125, viscosity=0.001
        )
        assert water.fbar == libmpm.FBar(form="two-volume", ratio=0.98)
        stroke = np.loadtxt(OWN / "stroke.csv", delimiter=",")
        low, high = water.shape.bounds()
        assert low[0] == pytest.approx(0.6 + stroke[0, 1], abs=1e-9)
        # 5.4 × 0.5 of water less the bed: a ramp to 0.3 over 1.5 m and 1.5 m of it.
        rng = np.random.default_rng(1)
        points = rng.uniform(low, high, (50_000, 3))
        share = np.mean(water.shape.distance(points) < 0)
        volume = share * math.prod(b - a for a, b in zip(low, high, strict=True))
        length = 6.0 - low[0]
        expected = (0.5 * length - 0.5 * 1.5 * 0.3 - 1.5 * 0.3) * 0.4
        assert volume == pytest.approx(expected, rel=0.01)  # 50 000 points: 0.3 % at one sigma

    def test_array_of_debris_is_one_body_a_piece(self, flume: claymore.Imported) -> None:
        found = flume
        assert body_of(found, "debris-1").shape == shapes.Box(
            lower=(2.0, 0.5, 0.1), upper=(2.2, 0.7, 0.2)
        )
        assert body_of(found, "debris-2").shape.lower[0] == 2.5

    def test_boundaries(self, flume: claymore.Imported) -> None:
        found = flume
        assert isinstance(boundary_of(found, "walls").shape, shapes.DomainWalls)
        assert boundary_of(found, "walls").time is None  # its window is longer than the run
        assert boundary_of(found, "box").response == boundaries.Separable(
            static_friction=0.3, dynamic_friction=0.2
        )
        bed = boundary_of(found, "bathymetry")
        assert bed.layer == boundaries.DecayLayer()
        points = np.array([(x, y, 0.2) for x, y in ((1.0, 0.0), (3.75, 0.15), (5.5, 0.3))])
        np.testing.assert_allclose(bed.shape.distance(points), 0.0, atol=1e-12)

    def test_paddle_moves_by_the_second_column(self, flume: claymore.Imported) -> None:
        found = flume
        paddle = boundary_of(found, "paddle")
        stroke = np.loadtxt(OWN / "stroke.csv", delimiter=",")
        time, way = paddle.motion.table.arrays()
        np.testing.assert_allclose(time, stroke[:, 0])
        np.testing.assert_allclose(way[:, 0], stroke[:, 1])
        assert not np.any(way[:, 1:])
        assert paddle.shape.upper[0] == 0.6
        # However far it goes, its back stays outside the domain.
        assert paddle.shape.lower[0] + way[:, 0].max() < 0

    def test_columns_in_the_order_of_the_dissertation_are_told_apart(self, edited: Any) -> None:
        path = edited("flume", lambda data: None)
        stroke = np.loadtxt(path.parent / "stroke.csv", delimiter=",")
        np.savetxt(path.parent / "stroke.csv", stroke[:, [0, 2, 1]], delimiter=",")
        found = claymore.load(path)
        way = boundary_of(found, "paddle").motion.table.arrays()[1]
        np.testing.assert_allclose(way[:, 0], stroke[:, 1])
        assert any("columns 2 and 3" in note for note in found.notes)

    def test_sensors(self, flume: claymore.Imported) -> None:
        found = flume
        placed = {s.name: s.sensor for s in found.scene.sensors}
        force = placed["force-1"]
        assert (force.attribute, force.operation, force.direction) == ("force", "sum", "x+")
        # The window holds the nodes on both sides of the face at 4.8 m, not more across.
        assert force.region == shapes.Box(lower=(4.7, 0.6, 0.0), upper=(5.0, 0.9, 0.4))
        gauge = placed["elevation-1"]
        assert (gauge.attribute, gauge.operation, gauge.interval) == ("Elevation", "max", 0.05)
        tracker = placed["track-water"]
        assert tracker.ids == (0, 7)
        assert tracker.attributes == ("Position_X", "Pressure")

    def test_every_key_without_effect_is_listed(self, edited: Any) -> None:
        def change(data: dict[str, Any]) -> None:
            data["sim_speed"] = 3
            data["bodies"][0]["material"]["flavour"] = "salt"

        found = claymore.load(edited("flume", change))
        text = "\n".join(found.ignored)
        for key in (
            "sim_speed: not known", "bodies[0].material.flavour: not known", "bodies[0].color",
            "bodies[0].gpu", "simulation.save_suffix", "bodies[1].material.friction_angle",
            "bodies[0]: partition_start, partition_end", "boundaries[3].output_frequency",
        ):  # fmt: skip
            assert key in text
        assert all(row in found.report() for row in [*found.ignored, *found.notes])

    def test_runs(self, flume: claymore.Imported) -> None:
        found = flume
        sim = run_steps(found.scene, 60)
        mass = sim.particles["water"]["mass"].sum()
        volume = (0.5 * (6.0 - 0.6) - 0.5 * 1.5 * 0.3 - 1.5 * 0.3) * 0.4
        assert mass == pytest.approx(998 * volume, rel=5e-3)
        # The surface stands where the file has it: half a particle below at the highest one.
        level = sim.sensors["elevation-1"].values[0, 0]
        assert level == pytest.approx(0.5, abs=0.05)

    def test_round_trip_as_a_run_file(self, tmp_path: Path, flume: claymore.Imported) -> None:
        from libmpm._src.scene.run_file import read_run_file

        found = flume
        path = tmp_path / "scene.json"
        path.write_text(json.dumps(found.run_file().to_dict()))
        again = read_run_file(path)
        assert again.scene == found.scene
        assert again.settings == found.run


class TestFirstDialect:
    """`models`, `device`, `grid-boundaries`, `FBAR_ratio`, names beside the material."""

    def test_materials(self, models: claymore.Imported) -> None:
        found = models
        sand = body_of(found, "drucker-prager").material
        # E/(1 - 2ν) c = 2000 Pa of mean tension, and the cone through that apex.
        assert sand == materials.DruckerPrager(
            density=1600, youngs_modulus=1e6, poissons_ratio=0.25, friction_angle=35,
            cohesion=2000 * math.tan(math.radians(35)), tension_cutoff=2000.0,
            volume_correction=0.5, cone="compression",
        )  # fmt: skip
        assert body_of(found, "von-mises").material == materials.VonMises(
            density=2000, youngs_modulus=2e6, poissons_ratio=0.3, yield_stress=1e4
        )

    def test_transfers_and_fbar(self, models: claymore.Imported) -> None:
        found = models
        water, sand, metal = found.scene.bodies
        assert found.scene.transfer.scheme == "ASFLIP"
        assert (water.transfer.flip, water.transfer.shift_max) == (0.9, 0.1)
        assert sand.transfer.flip == 0.0
        assert (metal.transfer.flip, metal.transfer.shift_max) == (0.5, 0.0)
        assert water.fbar == libmpm.FBar(form="split", ratio=0.9)
        assert sand.fbar is None

    def test_shapes(self, models: claymore.Imported) -> None:
        found = models
        water = body_of(found, "water").shape
        inside = np.array([(0.05, 0.05, 0.05), (0.5, 0.4, 0.4), (0.5, 0.4, 0.61)])
        assert (water.distance(inside) < 0).tolist() == [True, False, True]
        cylinder = body_of(found, "drucker-prager").shape
        assert cylinder == shapes.Cylinder(start=(1.5, 0, 0.4), end=(1.5, 0.5, 0.4), radius=0.2)
        turned = body_of(found, "von-mises").shape
        # By 30° about y through its middle, right-handed: (x, z) -> (x c + z s, -x s + z c).
        c, s = math.cos(math.pi / 6), math.sin(math.pi / 6)
        corner = (0.55 + 0.15 * c + 0.1 * s, 0.9, 0.4 - 0.15 * s + 0.1 * c)
        assert turned.distance(np.array([corner]))[0] == pytest.approx(0, abs=1e-12)

    def test_boundaries(self, models: claymore.Imported) -> None:
        found = models
        faces = boundary_of(found, "walls").response
        assert faces["x-"] == boundaries.Slip()
        assert faces["y-"] == boundaries.Separable(static_friction=0.5, dynamic_friction=0.4)
        pillar = boundary_of(found, "cylinder").shape
        assert pillar.radius == pytest.approx(0.1)
        assert np.subtract(pillar.end, pillar.start)[[0, 2]].tolist() == [0, 0]
        assert boundary_of(found, "box").time == (0.0, 0.1)
        region = boundary_of(found, "region")
        assert region.response == boundaries.Prescribed(components=("x",))
        assert region.motion.value == ((0.5, 0.0, 0.0),)

    def test_runs(self, models: claymore.Imported) -> None:
        found = models
        sim = run_steps(found.scene, 10)
        water = sim.particles["water"]["mass"].sum()
        assert water == pytest.approx(1000 * (0.48 - 4 / 3 * math.pi * 0.2**3), rel=5e-3)
        sand = sim.particles["drucker-prager"]["mass"].sum()
        assert sand == pytest.approx(1600 * math.pi * 0.2**2 * 0.5, rel=5e-3)


class TestWorkflow:
    """HydroUQ's wrapper: a body on several devices, presets, switches."""

    def test_bodies_of_several_devices_are_one(self, workflow: claymore.Imported) -> None:
        found = workflow
        names = [b.name for b in found.scene.bodies]
        assert names == ["fluid", *(f"debris-{i}" for i in range(1, 5))]
        assert any("the same body on other devices" in note for note in found.notes)

    def test_switches(self, workflow: claymore.Imported) -> None:
        found = workflow
        assert [s.name for s in found.scene.sensors] == ["LoadCell1", "WaveGauge1"]
        assert any("toggle is false" in row for row in found.ignored)
        assert any("apply_array is false" in row for row in found.ignored)
        assert "GeneralInformation: HydroUQ's own" in found.ignored

    def test_bed_of_the_large_wave_flume(self, workflow: claymore.Imported) -> None:
        bed = boundary_of(workflow, "lwf-bed").shape
        # Bonus (2023) 7.1 in scene coordinates, flume x + 2 m.
        heights = {10: 0.225, 18: 0.225, 25.4125: 0.6875, 30.9: 1.15, 45.525: 1.75, 60: 1.75,
                   89.45: 2.35}  # fmt: skip
        points = np.array([(x, y, 1.0) for x, y in heights.items()])
        np.testing.assert_allclose(bed.distance(points), 0, atol=1e-9)

    def test_runs(self, workflow: claymore.Imported) -> None:
        run_steps(workflow.scene, 5)


class TestRefusals:
    """All problems at once, each by its path, with the remedy."""

    def test_all_at_once(self) -> None:
        with pytest.raises(libmpm.SceneError) as error:
            claymore.load(OWN / "refused.json")
        text = str(error.value)
        for part in (
            "simulation.domain", "simulation.default_dx is '0.1'", "simulation.gravity",
            "simulation.fps is 0", "constitutive is 'CoupledUP', which is refused",
            "bodies[0].material.rho is -5", "use_FEM true", "FBAR_psi is 1.5",
            "bodies[1].geometry[0].object is 'pyramid'", "constitutive is 'Jelly'",
            "operation is 'multiply'", "geometry[0].array", "boundaries[0].object is 'Moon base'",
            "boundaries[1].contact is 'glued'", "grid-sensors[0].direction",
            "particle-sensors[0].operation is 'median'", "meshes",
        ):  # fmt: skip
            assert part in text

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            (lambda d: d["boundaries"][3].update(file="no.csv"), "motion_folder"),
            (lambda d: d["bodies"][1]["material"].update(poisson=0.1, nu=0.2), "mean the same"),
            (lambda d: d["bodies"][0].update(constitutive="Sand"), "keep one of them"),
            (lambda d: d["bodies"][0]["geometry"][0].update(offset=[50, 0, 0]), "nothing in the"),
            (
                lambda d: d["bodies"][0]["geometry"][0].update(object="file", file="a.bgeo"),
                "checkpoint=",
            ),
            (lambda d: d["simulation"].update(cauchy_bulk_ratio=3), "cauchy_bulk_ratio"),
            (lambda d: d["particle-sensors"][0].update(attribute="Colour"), "Colour"),
            (lambda d: d.pop("bodies"), "bodies"),
        ],
    )
    def test_one(self, edited: Any, change: Any, message: str) -> None:
        with pytest.raises(libmpm.SceneError, match=message):
            claymore.load(edited("flume", change))

    def test_not_a_scene(self, tmp_path: Path) -> None:
        path = tmp_path / "a.json"
        path.write_text('{"libmpm": 1}')
        with pytest.raises(libmpm.SceneError, match="neither bodies"):
            claymore.load(path)
        with pytest.raises(libmpm.SceneError, match="no such file"):
            claymore.load(tmp_path / "b.json")


class TestVariants:
    """What scenes of the family have beside that."""

    def test_spellings_of_keys_do_not_count(self, edited: Any, flume: claymore.Imported) -> None:
        def change(data: dict[str, Any]) -> None:
            body = data["bodies"][1]["material"]
            body["Poissons-Ratio"] = body.pop("poisson_ratio")
            body["Young's Modulus"] = body.pop("youngs_modulus")
            data["GRID_BOUNDARIES"] = data.pop("boundaries")
            data["bodies"][0]["algorithm"]["FBAR_antilocking_ratio"] = data["bodies"][0][
                "algorithm"
            ].pop("FBAR_psi")

        found = claymore.load(edited("flume", change))
        assert found.scene.bodies == flume.scene.bodies
        assert found.scene.boundaries == flume.scene.boundaries

    def test_froude_scaling(self, edited: Any, flume: claymore.Imported) -> None:
        one = flume
        four = claymore.load(edited("flume", lambda d: d["simulation"].update(froude_scaling=4.0)))
        assert four.scene.cell_size == pytest.approx(0.4)
        assert four.scene.cells == one.scene.cells
        assert four.run.until == pytest.approx(4.0)
        assert four.scene.gravity == one.scene.gravity
        way = [boundary_of(x, "paddle").motion.table for x in (one, four)]
        assert way[1].time[-1] == pytest.approx(2 * way[0].time[-1])
        assert way[1].value[-1][0] == pytest.approx(4 * way[0].value[-1][0])

    def test_coarse_cells_keep_the_walls(self) -> None:
        found = claymore.load(OWN / "flume.json", cell_size=0.3)
        assert found.scene.cells == (20, 3, 1)
        # Height 1.0 and width 0.4 are no whole numbers of cells; water goes on to the walls.
        assert found.scene.upper == pytest.approx((6.0, 0.9, 0.3))
        assert body_of(found, "water").shape.bounds()[1][2] == pytest.approx(0.3)
        assert sum("upper wall on axis" in note for note in found.notes) == 2
        found.scene.validate()

    def test_overlapping_bodies(self, edited: Any) -> None:
        def change(data: dict[str, Any]) -> None:
            data["bodies"][1]["geometry"][0].update(offset=[2.0, 0.4, 0.1])

        found = claymore.load(edited("flume", change))
        assert body_of(found, "debris-1").subtract_from == ("water",)
        found.scene.validate()

    def test_start_time_shifts_motion_and_windows(self, edited: Any) -> None:
        def change(data: dict[str, Any]) -> None:
            data["simulation"]["time"] = 0.5
            data["boundaries"][2]["time"] = [0, 1.5, 0]

        found = claymore.load(edited("flume", change))
        stroke = np.loadtxt(OWN / "stroke.csv", delimiter=",")
        at_start = np.interp(0.5, stroke[:, 0], stroke[:, 1])
        table = boundary_of(found, "paddle").motion.table
        assert table.at(0.0)[0] == pytest.approx(at_start)
        assert boundary_of(found, "box").time == (0.0, 1.0)

    @pytest.mark.parametrize(
        ("boundary", "names"),
        [
            ({"object": "USGS_RAMP", "friction_static": 0.6}, ["usgs-bed-1", "usgs-bed-2"]),
            ({"object": "USGS Gate"}, ["gate-1", "gate-2"]),
            ({"object": "OSU TWB Ramp"}, ["twb-bed"]),
            ({"object": "TOKYO_HARBOR"}, ["harbor"]),
            ({"object": "WASIRF_PUMP", "velocity": [0.6, 0, 0]}, ["region"]),
            ({"object": "Sphere", "contact": "Slip"}, ["sphere"]),
            ({"object": "Plane", "domain_end": [6, 0.1, 0.4]}, ["plane"]),
            ({"object": "Box", "array": [2, 1, 1], "spacing": [0.8, 0, 0]}, ["box-1", "box-2"]),
        ],
    )
    def test_objects(self, edited: Any, boundary: dict[str, Any], names: list[str]) -> None:
        base = {"contact": "Separable", "domain_start": [3.5, 0.6, 0.1],
                "domain_end": [3.8, 0.9, 0.4]}  # fmt: skip

        def change(data: dict[str, Any]) -> None:
            data["boundaries"] = [data["boundaries"][0], base | boundary]

        found = claymore.load(edited("flume", change))
        assert [b.name for b in found.scene.boundaries] == ["walls", *names]
        found.scene.validate()

    def test_copies_to_the_other_side(self, edited: Any) -> None:
        """A negative spacing is accepted; the same places as from the other end."""

        def copies(offset: list[float], spacing: list[float]) -> Any:
            def change(data: dict[str, Any]) -> None:
                data["bodies"][1]["geometry"] = [
                    {
                        "object": "Box", "operation": "add", "offset": offset,
                        "span": [0.2, 0.1, 0.1], "array": [2, 1, 1], "spacing": spacing,
                    }
                ]  # fmt: skip

            scene = claymore.load(edited("flume", change)).scene
            return sorted(b.shape.bounds() for b in scene.bodies)

        assert copies([2.4, 0.6, 0.1], [-0.4, 0, 0]) == copies([2.0, 0.6, 0.1], [0.4, 0, 0])
        with pytest.raises(libmpm.SceneError, match="a distance that is not 0"):
            copies([2.4, 0.6, 0.1], [0, 0, 0])

    def test_a_sensor_from_high_to_low(self, edited: Any) -> None:
        def change(data: dict[str, Any]) -> None:
            one = data["particle-sensors"][0]
            one["domain_start"], one["domain_end"] = one["domain_end"], one["domain_start"]

        plain, turned = (claymore.load(edited("flume", c)) for c in (lambda data: None, change))
        assert turned.scene.sensors == plain.scene.sensors
        assert "from high to low" in turned.report()

    def test_particles_of_a_file(self, edited: Any) -> None:
        def change(data: dict[str, Any]) -> None:
            data["bodies"][1]["geometry"] = [
                {
                    "object": "file",
                    "operation": "add",
                    "file": "points.csv",
                    "offset": [2, 0.6, 0.1],
                }
            ]

        path = edited("flume", change)
        (path.parent / "points.csv").write_text("0.0,0.0,0.0\n0.05,0.0,0.0\n0.1,0.0,0.0\n")
        found = claymore.load(path)
        # ClaymoreUW's particles have the mass of a cell over ppc.
        assert body_of(found, "debris").shape.particle_volume == pytest.approx(0.1**3 / 8)

    def test_checkpoint_takes_the_place_of_the_files(
        self, edited: Any, flume: claymore.Imported, tmp_path: Path
    ) -> None:
        sim = run_steps(flume.scene, 5)
        sim.save_checkpoint(tmp_path / "five.ckpt")

        def change(data: dict[str, Any]) -> None:
            data["simulation"]["time"] = 2.0
            data["bodies"][0]["geometry"] = [
                {"object": "file", "operation": "add", "file": "../model[0].bgeo",
                 "has_attributes": True, "input_attribs": ["J"]}
            ]  # fmt: skip

        path = edited("flume", change)
        found = claymore.load(path, checkpoint=tmp_path / "five.ckpt")
        assert found.scene.start is not None
        assert [b.name for b in found.scene.bodies] == ["water", "debris-1", "debris-2"]
        on = libmpm.Simulation(found.scene, device="cpu", precision="single")
        assert on.time == pytest.approx(sim.time)
        on.step(5)
        assert np.all(np.isfinite(on.particles["water"]["velocity"]))


def test_reading_twice_gives_the_same(flume: claymore.Imported) -> None:
    one, two = flume, claymore.load(OWN / "flume.json")
    assert one.scene == two.scene
    assert one.notes == two.notes
    assert one.ignored == two.ignored
