"""Random small scenes on grids of functions for hypothesis: every basis, mass form, solver, body,
hold and sensor that is built there."""

from __future__ import annotations

from typing import Any

from hypothesis import strategies as st

import libmpm
from libmpm import boundaries, grids, materials, sensors, shapes

#: Laws of such grids; waves of 10 m/s.
_ELASTIC = {"density": 1000.0, "youngs_modulus": 1e5, "poissons_ratio": 0.3}
LAWS = {
    "hypoelastic": materials.Hypoelastic(**_ELASTIC),
    "linear": materials.LinearElastic(**_ELASTIC),
    "neo-hookean": materials.NeoHookean(**_ELASTIC),
    "plastic": materials.VonMises(**_ELASTIC, yield_stress=500.0),
}
BASES = {
    "linear": grids.Linear(),
    "lagrange": grids.Lagrange(degree=2),
    "splines": grids.PowellSabin(),
    "cubic": grids.CubicPowellSabin(),
}
#: Where not all functions are positive no row may be lumped.
POSITIVE = ("linear", "splines", "tensor")


@st.composite
def masses(draw: Any, positive: bool) -> Any:
    """How M a = F is made and solved."""
    forms = ["consistent", "consistent", *(["lumped", "rows", "symmetric"] if positive else [])]
    form = draw(st.sampled_from(forms))
    if form == "lumped":
        return grids.LumpedMass()
    if form != "consistent":
        return grids.PartialMass(form=form)
    return grids.ConsistentMass(
        solver=draw(st.sampled_from(("direct", "cg", "richardson"))),
        deactivate_below=draw(st.sampled_from((0.0, 1e-6))),
    )


@st.composite
def scenes(draw: Any) -> libmpm.Scene:
    """One or two bodies that fall, slide or fly over the cells of a unit square."""
    kind = draw(st.sampled_from((*BASES, "tensor")))
    mass = draw(masses(kind in POSITIVE))
    n = draw(st.sampled_from((3, 4)))
    if kind == "tensor":
        degree = (draw(st.integers(1, 2)), 2)
        grid: Any = grids.SplineGrid(
            lower=(0, 0), upper=(1, 1), spans=(n + 2, n + 2), degree=degree, mass=mass
        )
    else:
        mesh = grids.Mesh.blocks(columns=n, rows=n, lower=(0, 0), upper=(1, 1))
        grid = grids.TriangularGrid(mesh=mesh, basis=BASES[kind], mass=mass)
    down = draw(st.sampled_from((0.0, 9.81)))
    gravity: Any = (0.0, -down)
    if draw(st.booleans()):
        gravity = libmpm.TimeTable((0.0, 0.05), (gravity, (1.0, -down)), "hold")
    method = libmpm.Method(
        cfl=draw(st.sampled_from((0.2, 0.5))), leaving=draw(st.sampled_from(("stop", "delete")))
    )
    scene = libmpm.Scene(grid=grid, gravity=gravity, method=method)
    count = draw(st.integers(1, 2))
    for i in range(count):
        law = draw(st.sampled_from(tuple(LAWS)))
        left, low = 0.5 * i + 0.07, draw(st.sampled_from((0.0, 0.11, 0.3)))
        traction = libmpm.grids.Traction(
            face="y+", value=libmpm.TimeTable((0.0, 0.1), ((0.0, 0.0), (50.0, -500.0)))
        )
        scene.add_body(
            name=f"{law} {i}",
            shape=shapes.Box(lower=(left, low), upper=(left + 0.36, low + 0.5)),
            material=LAWS[law],
            lattice=(9, 12),
            # Fast enough to enter and leave cells within a few steps.
            velocity=draw(st.sampled_from(((0.0, 0.0), (1.0, 0.5), (0.3, -1.0)))),
            tractions=(traction,) if draw(st.booleans()) else (),
        )
    smooth = st.sampled_from((boundaries.Slip(), boundaries.Sticky()))
    window = draw(st.sampled_from((None, None, (0.0, 0.01), (0.005, 1.0))))
    scene.add_boundary(
        name="walls",
        shape=shapes.DomainWalls(faces=draw(st.sampled_from((("y-",), ("x-", "x+", "y-"), "all")))),
        response=draw(smooth),
        time=window,
    )
    first = scene.bodies[0].name
    scene.add_sensor(name="load", sensor=sensors.LoadCell(boundary="walls"))
    scene.add_sensor(name="energy", sensor=sensors.Energy(interval=0.003))
    scene.add_sensor(name="track", sensor=sensors.ParticleTracker(body=first, ids=(3, 5)))
    probe = sensors.VelocityProbe(position=(0.3, 0.3), interval=0.002)
    scene.add_sensor(name="v", sensor=probe)
    return scene
