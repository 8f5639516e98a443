"""Small valid scene files that together have every kind of value a scene file can hold.

Written for fuzzers: few particles, few steps, every key filled in.
"""

from __future__ import annotations

import functools
import json
import math
from pathlib import Path
from typing import Any

import numpy as np

import libmpm
from libmpm import boundaries, contacts, grids, materials, sensors, shapes

SOLID = {"density": 800.0, "youngs_modulus": 1e5, "poissons_ratio": 0.3}
WATER = materials.TaitFluid(density=1000.0, bulk_modulus=2e5, viscosity=0.1)

#: Corners of a tetrahedron and its faces, outward.
_CORNERS = ((0.0, 0.0, 0.0), (0.4, 0.0, 0.0), (0.0, 0.4, 0.0), (0.0, 0.0, 0.4))
_FACES = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2))


def mesh_texts() -> dict[str, str]:
    """A closed surface in the formats that the readers know, ending -> text."""
    facets = "".join(
        "facet normal 0 0 0\nouter loop\n"
        + "".join(f"vertex {' '.join(map(str, _CORNERS[k]))}\n" for k in face)
        + "endloop\nendfacet\n"
        for face in _FACES
    )
    corners = [" ".join(map(str, c)) for c in _CORNERS]
    ply = (
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
        "property float z\nelement face 4\nproperty list uchar int vertex_indices\nend_header\n"
    )
    return {
        ".stl": f"solid s\n{facets}endsolid s\n",
        ".obj": "".join(f"v {c}\n" for c in corners)
        + "".join(f"f {' '.join(str(k + 1) for k in face)}\n" for face in _FACES),
        ".ply": ply
        + "".join(f"{c}\n" for c in corners)
        + "".join(f"3 {' '.join(map(str, face))}\n" for face in _FACES),
        ".off": "OFF\n4 4 0\n"
        + "".join(f"{c}\n" for c in corners)
        + "".join(f"3 {' '.join(map(str, face))}\n" for face in _FACES),
    }


def point_texts() -> dict[str, str]:
    """Points of particles in the formats that `PointFile` knows, ending -> text."""
    rows = [(0.05 + 0.1 * i, 0.05 + 0.1 * j) for i in range(3) for j in range(2)]
    return {
        ".csv": "x,y\n" + "".join(f"{x},{y}\n" for x, y in rows),
        ".txt": "".join(f"{x} {y}\n" for x, y in rows),
    }


def _scene(dimension: int, size: float = 1.0, **changes: Any) -> libmpm.Scene:
    arguments: dict[str, Any] = {
        "dimension": dimension,
        "cell_size": 0.1,
        "lower": (0.0,) * dimension,
        "upper": (size,) * dimension,
        "origin": (10.0,) * dimension,
        "gravity": (0.0,) * (dimension - 1) + (-9.81,),
    }
    return libmpm.Scene(**(arguments | changes))


def _box(*ends: float) -> shapes.Box:
    half = len(ends) // 2
    return shapes.Box(lower=ends[:half], upper=ends[half:])


def _plane() -> libmpm.Scene:
    """2D: fluids, walls of every kind, flows, motions, the older sensors."""
    steps = libmpm.TimeTable((0, 0.5, 1), ((0, 0), (0.2, 0), (0, 0)), "zero")
    scene = _scene(
        2,
        gravity=libmpm.TimeTable((0, 1), ((0, -9.81), (1, -9)), "repeat"),
        method=libmpm.Method(cfl=0.3, time_step=1e-5, leaving="delete"),
        name="plane",
    )
    scene.add_body(
        name="water", shape=_box(0, 0.1, 0.5, 0.4), material=WATER, hydrostatic=0.4,
        particles_per_cell=4, fbar=libmpm.FBar(form="one-volume", time=0.01),
    )  # fmt: skip
    scene.add_body(
        name="mud", shape=_box(0.5, 0.1, 0.7, 0.3), fbar=libmpm.FBar(form="split", length=0.1),
        material=materials.HerschelBulkleyFluid(
            density=1500, yield_stress=30, consistency=5, index=0.6, largest_viscosity=200
        ),
        velocity=libmpm.Field(components=("0.1 * sin(pi * x)", "where(y > 0.2, -y, 0)")),
    )  # fmt: skip
    scene.add_body(
        name="block", shape=shapes.OrientedBox(centre=(0.35, 0.55), size=(0.3, 0.2), angle=10),
        material=materials.FixedCorotated(**SOLID), lattice=(5, 4), subtract_from=("water",),
        velocity=(0.1, -0.2), sampling=shapes.Jitter(share=0.2, seed=3),
    )  # fmt: skip
    scene.add_boundary(
        name="walls",
        shape=shapes.DomainWalls(faces=("y-", "y+")),
        response={"y-": boundaries.Sticky(), "y+": boundaries.Separable()},
    )
    scene.add_boundary(
        name="step", shape=_box(0.7, 0, 0.9, 0.2), motion=steps, time=(0.0, 0.5),
        response=boundaries.Separable(static_friction=0.4, dynamic_friction=0.3),
        within=_box(0.6, 0, 1, 0.5), bodies=("block",),
    )  # fmt: skip
    scene.add_boundary(
        name="paddle",
        shape=shapes.Sphere(centre=(0.85, 0.5), radius=0.12),
        response=boundaries.Slip(),
        motion=boundaries.Displacement(libmpm.TimeTable((0, 1), ((0, 0), (0.1, 0)), "hold")),
        layer=boundaries.DecayLayer(function="linear", thickness=1.5),
        rotation=boundaries.Rotation(about=(0.85, 0.5), rate=2.0),
        spacing=0.05,
    )
    scene.add_flow(
        name="in",
        flow=boundaries.Inflow(
            body="water", face="x-", velocity=0.5, level=0.4, bed=_box(0, 0, 0.5, 0.1), zone=3,
            max_particles=10_000,
        ),
    )  # fmt: skip
    rate = libmpm.TimeTable((0, 1), (0.0, 0.3))
    scene.add_flow(name="out", flow=boundaries.Outflow(face="x+", velocity=rate, zone=2))
    load = sensors.LoadCell(boundary="walls", faces=("y-",), interval=0.01, reference=(0, 0))
    scene.add_sensor(name="load", sensor=load)
    gauge = sensors.WaveGauge(position=(0.3,), body="water", interval=0.01)
    scene.add_sensor(name="gauge", sensor=gauge)
    scene.add_sensor(name="v", sensor=sensors.VelocityProbe(position=(0.3, 0.2), interval=0.01))
    track = sensors.ParticleTracker(body="water", ids=(3, 1), interval=0.01)
    scene.add_sensor(name="track", sensor=track)
    scene.add_sensor(name="energy", sensor=sensors.Energy(body="block", interval=0.01))
    return scene


def _solids() -> libmpm.Scene:
    """3D: a solid of every law and shape, and a wall that mirrors."""
    scene = _scene(3, 2.0, name="solids", method=libmpm.Method(cfl=0.3, leaving="freeze"))
    ball = shapes.Sphere(centre=(0.0, 0.0, 0.0), radius=0.15)
    post = shapes.Cylinder(start=(0, 0, 0), end=(0, 0, 0.3), radius=0.1)
    cube = _box(0, 0, 0, 0.2, 0.2, 0.2)
    cone = shapes.Cone(start=(0, 0, 0), end=(0, 0, 0.3), radius=0.15, end_radius=0.05)
    wedge = shapes.Wedge(lower=(0, 0, 0), upper=(0.3, 0.2, 0.3), high="x+", up="z+")
    prism = shapes.Extrusion(profile=((0, 0), (0.3, 0), (0, 0.3)), axis="y", lower=0.0, upper=0.2)
    plane = shapes.HalfSpace(point=(0, 0, 0.05), normal=(0, 0, 1))
    solids = [
        (ball | cube, materials.CamClay),
        (ball & plane, materials.LinearElastic),
        (ball - cube, materials.NeoHookean),
        (post.turned(30, axis="y", about=(0, 0, 0)), materials.StVenantKirchhoffHencky),
        (cube.repeated((2, 1, 1), (0.22, 0.3, 0.3)), materials.VonMises),
        (cone, materials.DruckerPrager),
        (wedge, materials.FixedCorotated),
        (prism, materials.NeoHookean),
    ]
    more = {
        materials.CamClay: {"log_plastic_volume": -0.05, "friction_angle": 40.0},
        materials.VonMises: {"yield_stress": 1e3},
        materials.DruckerPrager: {"cohesion": 100.0, "friction_angle": 30.0},
    }
    for i, (shape, law) in enumerate(solids):
        row, column = divmod(i, 3)
        scene.add_body(
            name=f"solid {i}",
            shape=shape.moved((0.3 + 0.6 * column, 0.3 + 0.6 * row, 0.5)),
            material=law(**(SOLID | more.get(law, {}))),
            particles_per_cell=1,
            velocity=(0.1, 0.0, -0.1),
            sampling=[None, shapes.Columns(axis="z"), shapes.PoissonDisk(seed=1)][i % 3],
        )
    scene.add_boundary(
        name="sides", shape=shapes.DomainWalls(faces=("x-", "y-")), response=boundaries.Mirror()
    )
    bed = shapes.HeightField(
        x=(0, 1, 2), y=(0, 2), z=((0.1, 0.1), (0.2, 0.2), (0.3, 0.1)), base=-0.2
    )
    scene.add_boundary(name="bed", shape=bed, response=boundaries.Separable())
    pump = _box(1.7, 1.7, 1.0, 1.9, 1.9, 1.4)
    scene.add_boundary(
        name="pump",
        shape=pump,
        response=boundaries.Prescribed(components=("x", "z")),
        motion=boundaries.Travel((0.1, 0, 0.2)),
        time=(0.1, math.inf),
    )
    touch = sensors.ContactForce(body="solid 0", by="solid 1", interval=0.01)
    scene.add_sensor(name="touch", sensor=touch)
    return scene


def _elements(dimension: int) -> libmpm.Scene:
    """A body of elements in the plane or in space, beside water that it is taken out of."""
    d = dimension
    scene = _scene(d, 1.0, name=f"elements in {d}D")
    scene.add_body(
        name="water", shape=_box(*(0,) * d, *(1.0, 0.4, 1.0)[:d]), material=WATER,
        particles_per_cell=1,
    )  # fmt: skip
    kind = shapes.Triangles if d == 2 else shapes.Tetrahedra
    mesh = kind.box(lower=(0.3,) * d, upper=(0.5,) * d, edge=0.1, volumes="vertex")
    scene.add_body(
        name="bar", shape=mesh, material=materials.NeoHookean(**SOLID), subtract_from=("water",),
        pins=(libmpm.grids.Pin(face="y-", components=("x",)),), stress=(10.0,) * (3 * d - 3),
    )  # fmt: skip
    scene.add_sensor(name="pin", sensor=sensors.PinForce(body="bar", interval=0.01))
    return scene


def _watched() -> libmpm.Scene:
    """2D: every sensor that is evaluated in Python, and a transfer that stores velocities."""
    transfer = libmpm.methods.Transfer(
        scheme="ASFLIP", flip=0.95, shift_max=0.5, shift_min=0.1, shift_rule="smooth"
    )
    method = libmpm.Method(
        transfer=transfer, kernel=libmpm.methods.Kernel(name="cubic", gradient="kernel")
    )
    scene = _scene(2, method=method, name="watched")
    scene.add_body(
        name="water", shape=_box(0, 0, 1, 0.3), material=WATER, hydrostatic=0.3,
        fbar=libmpm.FBar(form="two-volume", ratio=0.5),
        transfer=libmpm.methods.Transfer(scheme="ASFLIP", flip=0.9),
    )  # fmt: skip
    block = materials.FixedCorotated(**SOLID)
    scene.add_body(name="block", shape=_box(0.4, 0.35, 0.7, 0.6), material=block)
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
    part = {"region": _box(0, 0, 0.5, 0.5), "interval": 0.01}
    watching: dict[str, Any] = {
        "speed": sensors.ParticleSensor(attribute="speed", operation="max", body="water", **part),
        "force": sensors.GridSensor(attribute="force", operation="sum", direction="y+", **part),
        "body": sensors.BodyTracker(body="block", quantities=("velocity",), interval=0.01),
        "ids": sensors.AttributeTracker(
            body="water", ids=(7, 0), attributes=("pressure", "position"), interval=0.01
        ),
        "p": sensors.PressureProbe(
            position=(0.4, 0.2), radius=0.1, order=1, body="water", interval=0.01
        ),
        "eta": sensors.ElevationGauge(
            position=(0.5,), radius=0.1, method="percentile", percentile=90, body="water",
            interval=0.01,
        ),
        "column": sensors.ColumnGauge(
            position=(0.5,), width=0.1, bed=0.05, body="water", interval=0.01
        ),
        "own": sensors.Custom(function="count", columns=("n",), units=("1",), interval=0.01),
    }  # fmt: skip
    for name, sensor in watching.items():
        scene.add_sensor(name=name, sensor=sensor)
    return scene


def _files(folder: Path) -> list[libmpm.Scene]:
    """Scenes whose shapes are in files."""
    (folder / "tetra.stl").write_text(mesh_texts()[".stl"])
    (folder / "points.csv").write_text(point_texts()[".csv"])
    one = _scene(3, name="mesh")
    one.add_body(
        name="stone",
        shape=shapes.SurfaceMesh(file=str(folder / "tetra.stl"), scale=0.5, offset=(0.3, 0.3, 0.3)),
        material=materials.FixedCorotated(**SOLID),
    )
    two = _scene(2, name="points")
    two.add_body(
        name="given",
        shape=shapes.PointFile(
            file=str(folder / "points.csv"), particle_volume=0.01, scale=1.0, offset=(0.2, 0.2)
        ),
        material=materials.FixedCorotated(**SOLID),
    )
    return [one, two]


def _functions() -> list[libmpm.Scene]:
    """Scenes on grids of functions."""
    mesh = grids.Mesh.blocks(columns=2, rows=2, lower=(0, 0), upper=(1, 1))
    elastic = materials.Hypoelastic(density=1000, youngs_modulus=1e5, poissons_ratio=0.3)
    found = []
    for i, (basis, mass) in enumerate(
        (
            (grids.PowellSabin(), grids.ConsistentMass(solver="cg", deactivate_below=1e-9)),
            (grids.Linear(), grids.PartialMass(form="rows")),
            (grids.Lagrange(degree=2), None),
            (grids.CubicPowellSabin(), grids.ConsistentMass()),
        )
    ):
        grid = grids.TriangularGrid(mesh=mesh, basis=basis, mass=mass)
        scene = libmpm.Scene(grid=grid, gravity=(0, -9.81), name=f"functions {i}")
        body: dict[str, Any] = {
            "shape": shapes.Cells(within=((0, 0), (0.5, 0), (0.5, 1), (0, 1))),
            "particles_per_cell": 25,
        }
        if i == 0:
            body = {
                "shape": _box(0, 0, 1, 0.5),
                "particles_per_cell": 25,
                "stress": libmpm.Field(components=("-1000 * y", "x / 3", "0", "1")),
                "tractions": (
                    libmpm.grids.Traction(
                        face="x+", value=libmpm.TimeTable((0, 1), ((0, 0), (5, 1)))
                    ),
                ),
            }
        if i == 1:
            body["shape"] = shapes.Points(
                position=((0.3, 0.25), (0.3, 0.75), (0.7, 0.5)), volume=(0.1, 0.1, 0.1)
            )
            del body["particles_per_cell"]
        scene.add_body(name="bar", material=elastic, **body)
        outline = shapes.Outline(points=((0, 0), (1, 0)))
        scene.add_boundary(name="bed", shape=outline, response=boundaries.Sticky())
        found.append(scene)
    grid = grids.SplineGrid(
        lower=(0, 0),
        upper=(1, 1),
        degree=(2, 2),
        mass=grids.LumpedMass(),
        knots=((0, 0, 0, 0.5, 1, 1, 1), (0, 0, 0, 0.4, 1, 1, 1)),
    )
    splines = libmpm.Scene(grid=grid, name="splines")
    splines.add_body(name="b", shape=_box(0, 0, 1, 0.5), material=elastic, stress=(-10, 0, 0, 0))
    return [*found, splines]


def _methods() -> list[libmpm.Scene]:
    """Two small scenes with the rarer choices of the method."""
    found = []
    for method in (
        libmpm.Method(
            transfer=libmpm.methods.Transfer(scheme="XPIC", order=3, every=2), kernel="cubic"
        ),
        libmpm.Method(transfer="FLIP", kernel=libmpm.methods.Kernel(name="linear", boundary=True)),
        libmpm.Method(
            transfer="PIC",
            kernel=libmpm.methods.Kernel(name="linear", modified=True, moved_nodes=True),
        ),
    ):
        scene = _scene(2, method=method, name=f"method {len(found)}")
        scene.add_body(name="w", shape=_box(0, 0, 0.5, 0.4), material=WATER, fbar=None)
        scene.add_body(
            name="bar", shape=_box(0.6, 0.1, 0.9, 0.4), fbar=libmpm.FBar(form="stress-only"),
            material=materials.FixedCorotated(**SOLID),
        )  # fmt: skip
        scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
        found.append(scene)
    scene = _scene(2, method=libmpm.Method(transfer="FLIP"), name="over cells")
    scene.add_body(
        name="w", shape=_box(0, 0, 0.5, 0.4), material=WATER,
        smoothing=libmpm.methods.Smoothing(method="F0", gamma=0.5, field="volume"),
        assumed=libmpm.methods.AssumedFields(over="node", part="full", rate=False),
    )  # fmt: skip
    scene.add_body(
        name="bar", shape=_box(0.6, 0.1, 0.9, 0.4), material=materials.LinearElastic(**SOLID),
        stress=libmpm.Field(components=("-100 * y", "3", "x")),
        smoothing=libmpm.methods.Smoothing(method="F1", flux_length="inertia"), damping=0.02,
        force=libmpm.boundaries.PlacedForce(
            axis="x", place=(0.0, 1.0), value=((0.1, 0.0), (-0.1, 0.2))
        ),
    )  # fmt: skip
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
    return [*found, scene]


def started(folder: Path) -> libmpm.Scene:
    """A scene that goes on from a checkpoint in the folder."""
    scene = _scene(2)
    scene.add_body(name="w", shape=_box(0, 0, 0.5, 0.4), material=WATER)
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
    sim = libmpm.Simulation(scene, device="cpu", threads=1)
    sim.step(2)
    sim.save_checkpoint(folder / "state.npz")
    again = libmpm.Scene.from_checkpoint(folder / "state.npz")
    stone = materials.FixedCorotated(**SOLID)
    again.add_body(name="stone", shape=_box(0.1, 0.6, 0.3, 0.8), material=stone)
    return again


def as_file(scene: libmpm.Scene) -> Any:
    """The document of a scene, as a file would give it back."""
    return json.loads(json.dumps(scene.to_dict()))


def _touching() -> libmpm.Scene:
    """2D: bodies with fields of velocities of their own, by every law of contact."""
    scene = _scene(2, gravity=(0, -9.81), name="touching")
    scene.add_body(
        name="water", shape=_box(0, 0, 1, 0.2), material=WATER, particles_per_cell=4
    )  # fmt: skip
    for k in range(3):
        scene.add_body(
            name=f"block {k}", shape=_box(0.1 + 0.3 * k, 0.2, 0.3 + 0.3 * k, 0.4),
            material=materials.FixedCorotated(**SOLID), velocity=(1.0 - k, 0.0),
        )  # fmt: skip
    friction = contacts.Friction(static=0.4, dynamic=0.3)
    scene.add_contact(name="solid", between=("block 0", "block*"), law=friction)
    scene.add_contact(name="glue", between=("block 1", "block 2"), law=contacts.Stick())
    wet = contacts.Fluid(fill=0.6, friction=0.1)
    scene.add_contact(name="wet", between=("block*", "water"), law=wet)
    scene.add_boundary(
        name="walls", shape=shapes.DomainWalls(), response=boundaries.Separable()
    )  # fmt: skip
    scene.add_sensor(name="energy", sensor=sensors.Energy(interval=0.01))
    lift = sensors.ContactLoad(contact="wet", pair=("water", "block 1"), interval=0.01)
    scene.add_sensor(name="lift", sensor=lift)
    return scene


def _rigid() -> libmpm.Scene:
    """2D: a rigid block that floats, and one that a degree of freedom holds."""
    scene = _scene(2, gravity=(0, -9.81), name="rigid")
    scene.add_body(
        name="water", shape=_box(0, 0, 1, 0.3), material=WATER, particles_per_cell=4
    )  # fmt: skip
    for name, left, given in (
        ("log", 0.2, {}),
        ("held log", 0.6, {"held": ("x", "rotation"), "inertia": 2.0}),
    ):
        scene.add_body(
            name=name, shape=_box(left, 0.2, left + 0.2, 0.4), subtract_from=("water",),
            material=materials.Rigid(density=500.0, **given), velocity=(0.1, 0.0),
        )  # fmt: skip
    scene.add_contact(name="afloat", between=("*log", "water"), law=contacts.Fluid())
    scene.add_boundary(
        name="walls", shape=shapes.DomainWalls(), response=boundaries.Separable()
    )  # fmt: skip
    path = sensors.RigidMotion(body="log", interval=0.01)
    scene.add_sensor(name="path", sensor=path)
    return scene


def small_scenes(folder: Path) -> list[libmpm.Scene]:
    """Valid scenes with every kind of value, whose files lie in the folder."""
    scenes = [
        _plane(),
        _solids(),
        _elements(2),
        _elements(3),
        _watched(),
        _touching(),
        _rigid(),
        *_methods(),
        *_functions(),
        *_files(folder),
    ]
    return [*scenes, started(folder)]


@functools.lru_cache(maxsize=2)
def documents(folder: Path) -> dict[str, Any]:
    """Name -> scene file; to be copied before it is changed."""
    return {f"{i} {s.name}": as_file(s) for i, s in enumerate(small_scenes(folder))}


def kinds_in(item: Any) -> set[str]:
    """The "type" of every value in a document."""
    if isinstance(item, dict):
        own = {item["type"]} if isinstance(item.get("type"), str) else set()
        return own.union(*map(kinds_in, item.values()))
    return set().union(*map(kinds_in, item)) if isinstance(item, list) else set()


def given_arrays() -> dict[str, Any]:
    """Arrays that are no particles' velocities, name -> array of 20 rows of 2, or something."""
    good = np.zeros((20, 2))
    frozen = good.copy()
    frozen.setflags(write=False)
    bad = good.copy()
    bad[3, 1] = math.nan
    return {
        "good": good,
        "frozen": frozen,
        "strided": np.zeros((40, 4))[::2, ::2],
        "reversed": good[::-1],
        "fortran": np.asfortranarray(good),
        "single": good.astype(np.float32),
        "half": good.astype(np.float16),
        "integers": good.astype(np.int8),
        "big-endian": good.astype(">f8"),
        "list": good.tolist(),
        "not-a-number": bad,
        "infinite": np.full((20, 2), math.inf),
        "overflows single": np.full((20, 2), 1e300),
        "objects": np.full((20, 2), None),
        "numbers as objects": good.astype(object),
        "huge integers": np.full((20, 2), 10**400, dtype=object),
        "texts": np.full((20, 2), "fast"),
        "complex": good.astype(complex),
        "dates": np.zeros((20, 2), dtype="datetime64[s]"),
        "records": np.zeros(20, dtype=[("x", float), ("y", float)]),
        "empty": np.zeros((0, 2)),
        "a row": np.zeros(2),
        "turned": good.T,
        "three axes": np.zeros((20, 3)),
        "one more": np.zeros((21, 2)),
        "scalar": 0.0,
        "none": None,
        "ragged": [[0.0, 0.0], [0.0]],
        "a text": "velocity",
        "bytes": b"\0" * 320,
        "a set": {1.0, 2.0},
        "true": good.astype(bool),
    }
