"""Random small scenes for hypothesis: every law, shape, boundary, method and motion.

Bodies stand in slots of their own, so that most scenes are valid; those that ask for what is not
built together are refused, and count as such.
"""

from __future__ import annotations

from typing import Any

from hypothesis import strategies as st

import libmpm
from libmpm import boundaries, materials, sensors, shapes
from libmpm._src.methods.transfer import KERNELS, SCHEMES

#: Edge of a cell, m; a power of two, so that whole cells are added without rounding.
DX = 0.125
#: Wave speeds are near 10 m/s; what moves is slower than a twentieth of that.
SPEED = 0.5

_SOLID = {"density": 1000.0, "youngs_modulus": 1e5, "poissons_ratio": 0.3}
LAWS = {
    "water": materials.TaitFluid(bulk_modulus=1e5, viscosity=0.5),
    "mud": materials.HerschelBulkleyFluid(
        density=1500, bulk_modulus=1e5, yield_stress=30, consistency=5, largest_viscosity=50
    ),
    "corotated": materials.FixedCorotated(**_SOLID),
    "neo-hookean": materials.NeoHookean(**_SOLID),
    "hencky": materials.StVenantKirchhoffHencky(**_SOLID),
    "linear": materials.LinearElastic(**_SOLID),
    "metal": materials.VonMises(**_SOLID, yield_stress=1e3),
    "sand": materials.DruckerPrager(**_SOLID),
    "clay": materials.CamClay(**_SOLID, log_plastic_volume=-0.05),
}
#: Laws of which the work done on a body can be had back, and viscosity that takes it away.
CONSERVATIVE = ("water", "corotated", "neo-hookean", "hencky")

FORMS = ("one-volume-gradient", "one-volume", "two-volume", "stress-only", "split", "literal")


def _vectors(d: int, most: float) -> st.SearchStrategy[tuple[float, ...]]:
    return st.tuples(*[st.integers(-8, 8).map(lambda k: k / 8 * most)] * d)


@st.composite
def responses(draw: Any, mirrors: bool = True) -> Any:
    """What a wall does."""
    smooth = [boundaries.Slip(), boundaries.Sticky(), boundaries.Separable()]
    rough = [boundaries.Separable(static_friction=0.4, dynamic_friction=0.3)]
    mirror = [boundaries.Mirror(), boundaries.Mirror(slip=False)] if mirrors else []
    return draw(st.sampled_from(smooth + rough + mirror))


@st.composite
def methods(draw: Any) -> libmpm.Method:
    """Transfer, kernel and CFL number; most combinations exist."""
    scheme = draw(st.sampled_from(("APIC", *SCHEMES)))
    numbers: dict[str, Any] = {}
    if scheme in ("PIC-FLIP", "AFLIP", "SFLIP", "ASFLIP"):
        numbers["flip"] = draw(st.sampled_from((0.0, 0.5, 0.95, 1.0)))
    if scheme in ("SFLIP", "ASFLIP"):
        numbers |= {"shift_max": 0.5, "shift_rule": draw(st.sampled_from(("binary", "smooth")))}
    if scheme in ("XPIC", "FMPM"):
        numbers |= {"order": draw(st.integers(1, 4)), "every": draw(st.integers(1, 3))}
    kernel = libmpm.methods.Kernel(
        name=draw(st.sampled_from(("quadratic", *KERNELS))),
        gradient=draw(st.sampled_from((None, None, "kernel"))),
    )
    if scheme in ("APIC", "AFLIP", "ASFLIP") and not kernel.has_moments:
        kernel = libmpm.methods.Kernel()
    transfer = libmpm.methods.Transfer(scheme=scheme, **numbers)
    return libmpm.Method(cfl=draw(st.sampled_from((0.2, 0.4))), transfer=transfer, kernel=kernel)


@st.composite
def fbars(draw: Any, fluid: bool) -> Any:
    """The form of the volume smoothing of a body."""
    if draw(st.booleans()):
        return "default"
    form = draw(st.sampled_from((None, *FORMS)))
    if form is None or (not fluid and draw(st.booleans())):
        return None
    if form in ("two-volume", "split", "literal"):
        return libmpm.FBar(form=form, length=draw(st.sampled_from((0.1, 0.5))))
    return libmpm.FBar(form=form, time=0.05)


def _shape(
    draw: Any, low: tuple[float, ...], high: tuple[float, ...], kinds: tuple[str, ...]
) -> Any:
    d = len(low)
    kind = draw(st.sampled_from(kinds))
    box = shapes.Box(lower=low, upper=high)
    middle = tuple(0.5 * (a + b) for a, b in zip(low, high, strict=True))
    size = min(b - a for a, b in zip(low, high, strict=True))
    if kind == "turned":
        edges = tuple(0.6 * size for _ in low)
        return shapes.OrientedBox(centre=middle, size=edges, angle=draw(st.integers(0, 12)) * 15)
    ball = shapes.Sphere(centre=middle, radius=0.5 * size)
    if kind == "ball":
        return ball
    if kind == "cut":
        return box - shapes.HalfSpace(point=middle, normal=(0,) * (d - 1) + (1,)).moved(
            (0,) * (d - 1) + (-0.3 * size,)
        )
    return box


@st.composite
def scenes(draw: Any, *, plain: bool = False, closed: bool = False) -> libmpm.Scene:
    """A scene; `plain` has boxes, smooth walls and constant gravity, `closed` no gravity, and
    neither plasticity nor transfers that keep what the grid cannot see.
    """
    d = draw(st.sampled_from((2, 2, 3)))
    cells = (12, 8) if d == 2 else (8, 4, 4)
    top = tuple(n * DX for n in cells)
    down = 0.0 if closed else draw(st.sampled_from((0.0, 1.0, 9.81)))
    gravity: Any = (0.0,) * (d - 1) + (-down,)
    if not (plain or closed) and draw(st.booleans()):
        other = tuple(draw(_vectors(d, 9.81)))
        gravity = libmpm.TimeTable((0.0, 0.05), (gravity, other), "hold")
    method = draw(methods())
    if closed:
        transfer = draw(st.sampled_from(("PIC", "APIC")))
        method = libmpm.Method(cfl=0.1, transfer=transfer)
    scene = libmpm.Scene(
        dimension=d, cell_size=DX, lower=(0.0,) * d, upper=top, gravity=gravity, method=method
    )
    obstacle = draw(st.sampled_from(("none", "none", "box", "surface", "moving")))
    slots = draw(st.integers(1, 2 if obstacle != "none" or d == 3 else 3))
    # A particle on a node takes the slope of linear functions from its upper side. What it presses
    # on the node there is lost where that has no mass: at the edge of a body.
    aside = 0.01 if method.kernel_choice.name == "linear" else 0.0
    laws = CONSERVATIVE if closed else tuple(LAWS)
    for i in range(slots):
        law = draw(st.sampled_from(laws))
        fluid = law in ("water", "mud")
        left = i * (4 if d == 2 else 3)
        # Quarters of a cell, clear of the walls by up to two cells.
        gap = draw(st.integers(0, 4)) / 4 + aside
        others = [draw(st.integers(0, 8)) / 4 + aside for _ in range(d - 1)]
        low = tuple(x * DX for x in (left + gap, *others))
        size = [draw(st.sampled_from((1.5, 2.0, 2.5, 3.0) if d == 2 else (1.0, 1.5, 2.0)))
                for _ in range(d)]  # fmt: skip
        high = tuple(
            min(a + s * DX, t) for a, s, t in zip(low, size, (left * DX + 4 * DX, *top[1:]),
                                                   strict=True)
        )  # fmt: skip
        kinds = ("box",) if plain else ("box", "box", "turned", "ball", "cut")
        scene.add_body(
            name=f"{law} {i}",
            shape=_shape(draw, low, high, kinds),
            material=LAWS[law],
            velocity=draw(_vectors(d, SPEED)),
            fbar="default" if closed or not LAWS[law].table.fbar else draw(fbars(fluid)),
            particles_per_cell=2**d,
            hydrostatic=high[-1] if fluid and down and draw(st.booleans()) else None,
        )
    faces = [f"{axis}{end}" for axis in "xyz"[:d] for end in "-+"]
    smooth = st.sampled_from((boundaries.Slip(), boundaries.Sticky(), boundaries.Separable()))
    wall = smooth if plain else responses()
    response: Any = draw(wall)
    if not plain and draw(st.booleans()):
        response = {face: draw(wall) for face in faces}
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=response)
    if obstacle != "none" and not plain:
        _add_obstacle(draw, scene, obstacle if not closed else "box")
    for boundary in scene.boundaries:
        cell = sensors.LoadCell(boundary=boundary.name)
        scene.add_sensor(name=f"load {boundary.name}", sensor=cell)
    scene.add_sensor(name="energy", sensor=sensors.Energy())
    return scene


def _add_obstacle(draw: Any, scene: libmpm.Scene, kind: str) -> None:
    """Something to run into, right of all bodies."""
    d, top = scene.dimension, scene.upper
    end = top[0] - (DX if kind == "box" else 0.5 * DX)
    low, high = (top[0] - 2 * DX, *(0.0,) * (d - 1)), (end, *(x / 2 for x in top[1:]))
    response = draw(responses(mirrors=False))
    more: dict[str, Any] = {}
    shape: Any = shapes.Box(lower=low, upper=high)
    if kind != "box":
        middle = tuple(0.5 * (a + b) for a, b in zip(low, high, strict=True))
        shape = shapes.Sphere(centre=middle, radius=0.7 * DX)
        function = draw(st.sampled_from(("constrained", "linear", "cosine")))
        more["layer"] = boundaries.DecayLayer(function=function, thickness=1.5)
    if kind == "moving":
        way = libmpm.TimeTable((0.0, 1.0), ((0.0,) * d, (-0.5,) + (0.0,) * (d - 1)))
        more["motion"] = boundaries.Displacement(way)
    scene.add_boundary(name="thing", shape=shape, response=response, **more)


@st.composite
def runs(draw: Any) -> dict[str, Any]:
    """How a scene is run."""
    return {
        "precision": draw(st.sampled_from(("double", "single"))),
        "pipeline": draw(st.sampled_from(("auto", "auto", "auto", "two-pass", "phased", "phased"))),
    }
