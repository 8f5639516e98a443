"""Kernels: the engine against the naive method, what is refused, grid crossing and convergence.

Expected duration: 60 s, mostly the naive method and the finest boxes.
"""
# ruff: noqa: F811  the fixture `device` is imported

from itertools import pairwise

import numpy as np
import pytest

import libmpm
import libmpm.cases
from libmpm import Method, boundaries, materials, shapes
from libmpm.methods import Kernel, Transfer
from support import scenes
from support.devices import device  # noqa: F401
from support.methods_reference import AFFINE, DOMAINS, KERNELS, SCHEMES, agree, choose

OPTIONS = {
    "PIC-FLIP": {"flip": 0.9},
    "AFLIP": {"flip": 0.9},
    "SFLIP": {"flip": 0.9, "shift_max": 0.2, "shift_min": 0.05},
    "ASFLIP": {"flip": 0.9, "shift_max": 0.2, "shift_min": 0.05},
    "XPIC": {"order": 3, "every": 2},
    "FMPM": {"order": 3, "every": 2},
}
#: Linear functions, GIMP with an affine part, and clamped splines with half cells at the ends
#: accelerate a node that hardly any particle reaches without bound: such a run is soon over.
BRIEF = {"linear": 5, "ugimp": 20, "cpgimp": 20, "cpdi": 20, "ddmp": 5}


def allowed(kernel, scheme, boundary=False):
    return scheme not in AFFINE or (kernel not in ("linear", "ddmp") and not boundary)


UNIFORM = [(k, s) for k in KERNELS for s in SCHEMES if allowed(k, s)]
CLAMPED = [(k, s) for k in ("linear", "quadratic", "cubic") for s in SCHEMES if allowed(k, s, True)]


# ---- against the naive method -------------------------------------------------------------------


@pytest.mark.parametrize(("kernel", "scheme"), UNIFORM)
def test_every_scheme_in_2d(kernel, scheme, device):
    spec = scenes.specification(scenes.crowded(2))
    agree(choose(spec, scheme, kernel, **OPTIONS.get(scheme, {})), device, BRIEF.get(kernel, 30))


@pytest.mark.parametrize(("kernel", "scheme"), UNIFORM)
def test_every_scheme_in_3d(kernel, scheme, device):
    spec = scenes.specification(scenes.crowded(3))
    agree(
        choose(spec, scheme, kernel, **OPTIONS.get(scheme, {})),
        device,
        min(BRIEF.get(kernel, 6), 6),
    )


@pytest.mark.parametrize(
    ("kernel", "scheme"), [(k, s) for k in DOMAINS for s in SCHEMES if allowed(k, s)]
)
def test_particle_and_dual_domains_in_2d(kernel, scheme):
    spec = scenes.specification(scenes.crowded(2))
    agree(choose(spec, scheme, kernel, **OPTIONS.get(scheme, {})), "cpu", BRIEF[kernel])


@pytest.mark.parametrize(("kernel", "scheme"), [("cpdi", "ASFLIP"), ("cpdi", "XPIC"),
                                                ("ddmp", "FLIP")])  # fmt: skip
def test_particle_and_dual_domains_in_3d(kernel, scheme):
    spec = scenes.specification(scenes.crowded(3))
    agree(choose(spec, scheme, kernel, **OPTIONS.get(scheme, {})), "cpu", 1)


@pytest.mark.parametrize("kernel", DOMAINS)
def test_particle_and_dual_domains_are_refused_on_devices(kernel, device):
    spec = choose(scenes.specification(scenes.crowded(2)), "FLIP", kernel)
    if device == "cpu":
        pytest.skip("they are built for it")
    with pytest.raises(libmpm.SceneError, match=f"kernel '{kernel}' is not built for cuda"):
        scenes.engine(spec, device)


@pytest.mark.parametrize(("kernel", "scheme"), CLAMPED)
def test_boundary_splines(kernel, scheme, device):
    spec = scenes.specification(scenes.crowded(2))
    choose(spec, scheme, kernel, boundary=True, **OPTIONS.get(scheme, {}))
    agree(spec, device, 15 if kernel == "quadratic" else 5)


@pytest.mark.parametrize("kernel", ["linear", "quadratic", "cubic"])
def test_boundary_splines_in_3d(kernel, device):
    spec = scenes.specification(scenes.crowded(3))
    agree(choose(spec, "PIC-FLIP", kernel, boundary=True, flip=0.9), device, 5)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("scheme", ["PIC", "APIC", "ASFLIP"])
@pytest.mark.parametrize(
    ("kernel", "gradient"),
    [("quadratic", "kernel"), ("cubic", "kernel"), ("ugimp", "mls"), ("cpgimp", "mls")],
)
def test_the_other_gradient(kernel, gradient, scheme, dimension, device):
    spec = scenes.specification(scenes.crowded(dimension))
    choose(spec, scheme, kernel, gradient=gradient, **OPTIONS.get(scheme, {}))
    # At step 11 a node of 5e-8 particles moves at 40 m/s: force over mass is 1 over its weight.
    agree(spec, device, 10 if dimension == 2 else 6)


def test_stretched_particles(device):
    """cpGIMP follows the stretch: a body that contracts by a tenth is not that of uGIMP."""
    found = []
    for kernel in ("ugimp", "cpgimp"):
        spec = scenes.specification(scenes.free_body(2))
        body = spec["bodies"][0]
        body["velocity"] = -18.0 * (body["position"] - body["position"].mean(axis=0))
        choose(spec, "FLIP", kernel)
        machine, naive = agree(spec, device, 15)
        found.append(scenes.by_id(machine, 0, "position"))
    assert naive.half[0].min() < 0.95 * 0.25
    assert np.abs(found[0] - found[1]).max() > 1e-6


@pytest.mark.parametrize("precision", ["single", "double"])
def test_phased_is_the_fused_step(precision, device):
    """The same method by another route: positions agree to rounding."""
    found = []
    for pipeline in ("auto", "phased"):
        spec = scenes.specification(scenes.crowded(2), precision=precision, pipeline=pipeline)
        machine = scenes.engine(spec, device)
        scenes.advance(machine, 60)
        found.append(scenes.by_id(machine, 0, "position"))
    unit = {"single": 2e-4, "double": 1e-11}[precision]
    assert np.abs(found[0] - found[1]).max() < unit * 0.1


# ---- what is refused, and what is passed on -----------------------------------------------------


def pool(**choices):
    """A little water, with these choices of the method."""
    scene = libmpm.Scene(
        dimension=2, cell_size=0.1, lower=(0, 0), upper=(1, 1), gravity=(0, 0),
        method=Method(cfl=0.3, **choices),
    )  # fmt: skip
    scene.add_body(
        name="water",
        shape=shapes.Box(lower=(0, 0), upper=(0.5, 0.5)),
        material=materials.TaitFluid(bulk_modulus=2e5),
    )
    return scene


def refused(*words, **choices):
    """The error of a scene with these choices names all the words."""
    with pytest.raises(libmpm.SceneError) as caught:
        scenes.engine(scenes.specification(pool(**{k: v() for k, v in choices.items()})))
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize("scheme", AFFINE)
@pytest.mark.parametrize("kernel", ["linear", "ddmp", "quadratic boundary", "cubic boundary"])
def test_affine_transfers_need_second_moments(kernel, scheme):
    name, _, clamped = kernel.partition(" ")
    flip = None if scheme == "APIC" else 0.9
    refused(
        scheme, name, *([clamped] if clamped else []),
        transfer=lambda: Transfer(scheme=scheme, flip=flip),
        kernel=lambda: Kernel(name=name, boundary=bool(clamped)),
    )  # fmt: skip


@pytest.mark.parametrize("name", ["linear", "quadratic", "cubic", *DOMAINS])
def test_gradients_by_moments_need_them_too(name):
    refused(
        "mls", name,
        transfer=lambda: Transfer(scheme="FLIP"),
        kernel=lambda: Kernel(name=name, gradient="mls", boundary=name in ("quadratic", "cubic")),
    )  # fmt: skip


@pytest.mark.parametrize("kernel", DOMAINS)
def test_particle_and_dual_domains_on_ranks(kernel):
    given = pool(kernel=kernel, transfer="PIC").to_dict()
    given["bodies"][0]["velocity"] = [2.0, 0.0]
    scene = libmpm.Scene.from_dict(given)
    one = libmpm.Simulation(scene, device="cpu")
    cut = libmpm.Partition(cuts="x", at=(0.8,), rebalance_above=None)
    two = libmpm.Simulation(scene, device=["cpu", "cpu"], partition=cut)
    for sim in (one, two):
        sim.run(until=0.2)
    assert two.statistics["migrated"] > 0
    rows = [sim.gather("water", "position", "velocity", "stress") for sim in (one, two)]
    for name in rows[0]:
        assert (rows[0][name] == rows[1][name]).all(), name


def test_dual_domains_have_no_inlets():
    scene = pool(kernel="ddmp", transfer="PIC")
    inlet = boundaries.Inflow(body="water", face="x-", velocity=1.0, level=0.5)
    scene.add_flow(name="inlet", flow=inlet)
    with pytest.raises(libmpm.SceneError, match="kernel 'ddmp' with inlets"):
        scenes.engine(scenes.specification(scene))


def test_a_parallelepiped_that_outgrows_its_stencil_is_named():
    """A vortex shears its water without end."""
    options = libmpm.cases.Options(method=Method(kernel="cpdi"))
    with pytest.raises(libmpm.NumericalError, match="kernel 'cpdi' follows, grew beyond three"):
        libmpm.cases.run("vortex", options=options, device="cpu", cells=24, turnovers=1.0)


@pytest.mark.parametrize("kernel", DOMAINS)
def test_particle_and_dual_domains_resume_to_the_bit(kernel):
    spec = choose(scenes.specification(scenes.crowded(2)), "FLIP", kernel)
    straight, other = scenes.engine(spec), scenes.engine(spec)
    scenes.advance(straight, 2)
    other.load(straight.save())
    for machine in (straight, other):
        scenes.advance(machine, 3)
    for name in ("position", "velocity"):
        found = [scenes.by_id(machine, 0, name) for machine in (straight, other)]
        assert np.array_equal(*found)


@pytest.mark.parametrize("name", ["ugimp", "cpgimp", *DOMAINS])
def test_boundary_splines_are_splines(name):
    refused(
        "boundary", name,
        transfer=lambda: Transfer(scheme="FLIP"),
        kernel=lambda: Kernel(name=name, boundary=True),
    )  # fmt: skip


@pytest.mark.parametrize("pipeline", ["fused", "two-pass"])
@pytest.mark.parametrize("choice", [{"transfer": "PIC"}, {"kernel": "cubic"}])
def test_only_phases_have_them(choice, pipeline):
    with pytest.raises(libmpm.SceneError, match=pipeline) as caught:
        scenes.engine(scenes.specification(pool(**choice), pipeline=pipeline))
    assert "phased" in str(caught.value)


@pytest.mark.parametrize(("kernel", "scheme"), [*UNIFORM, ("quadratic boundary", "FLIP")])
def test_choices_reach_the_engine(kernel, scheme):
    """The user's values become the dictionary that these tests write by hand."""
    name, _, clamped = kernel.partition(" ")
    options = OPTIONS.get(scheme, {})
    found = scenes.specification(
        pool(
            transfer=Transfer(scheme=scheme, **options),
            kernel=Kernel(name=name, boundary=bool(clamped)),
        )
    )
    expected = choose(scenes.specification(pool()), scheme, name, boundary=bool(clamped), **options)
    assert found["kernel"] == expected["kernel"]
    assert found["transfer"] == expected["transfer"]
    for one, other in zip(found["bodies"], expected["bodies"], strict=True):
        assert one["transfer"] == other["transfer"]


# ---- grid crossing ------------------------------------------------------------------------------


def column_error(height, **options):
    """Stress error, parts of ρ g H, of a column that its weight, applied slowly, shortens by 10 %.

    Uniaxial: whatever the law, the nominal stress at the undeformed height X is ρ g (H - X), and
    with the sides held the Cauchy stress equals it. Particles cross up to H/10 cells on the way.
    Returns the rms over all but the lowest two cells, which the wall disturbs, and over all.
    """
    width, modulus, density = 2, 1e6, 1000.0
    g = 0.2 * modulus / density / height
    rise = 5 * 4 * height / np.sqrt(modulus / density)  # five periods of the column
    part = np.linspace(0, 1, 41)
    pull = [(0.0, -g * 0.5 * (1 - np.cos(np.pi * p))) for p in part]
    scene = libmpm.Scene(
        dimension=2, cell_size=1.0, lower=(0, 0), upper=(width, height + 4),
        gravity=libmpm.TimeTable(tuple(rise * part), tuple(pull)), method=Method(cfl=0.3),
    )  # fmt: skip
    scene.add_body(
        name="column",
        shape=shapes.Box(lower=(0, 0), upper=(width, height)),
        material=materials.FixedCorotated(
            density=density, youngs_modulus=modulus, poissons_ratio=0.0
        ),
        particles_per_cell=4,
    )
    scene.add_boundary(
        name="walls",
        shape=shapes.DomainWalls(faces=("x-", "x+", "y-")),
        response=boundaries.Slip(),
    )
    spec = choose(scenes.specification(scene), **options)
    x = spec["bodies"][0]["position"][:, 1]
    machine = scenes.engine(spec)
    while machine.time < rise:
        report = machine.run(200, rise, 60.0)
        # Where nodes run away the engine stops, or its clock shortens the step without end.
        if report["reason"] == "fault" or machine.step > 4000:
            return np.inf, np.inf
    stress = scenes.by_id(machine, 0, "stress")[:, 1, 1]
    error = (stress + density * g * (height - x)) / (density * g * height)
    return np.sqrt(np.mean(error[x > 2] ** 2)), np.sqrt(np.mean(error**2))


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"gradient": "kernel"},
        {"scheme": "FLIP"},
        {"kernel": "cubic"},
        {"kernel": "ugimp", "scheme": "FLIP"},
        {"kernel": "cpgimp", "scheme": "FLIP"},
        {"kernel": "cpdi", "scheme": "FLIP"},
        {"scheme": "FMPM", "order": 3},
    ],
    ids=lambda o: "-".join(map(str, o.values())) or "default",
)
def test_particles_cross_cells_quietly(options):
    """2 % of ρ g H, where the linear functions' jumps of the gradient leave more than half."""
    assert column_error(16, **options)[0] < 0.02


@pytest.mark.parametrize("scheme", ["PIC", "FLIP"])
def test_dual_domains_let_them_cross(scheme):
    """Differences over two cells are coarser than splines, and do not jump."""
    assert column_error(16, kernel="ddmp", scheme=scheme)[0] < 0.03


@pytest.mark.parametrize("scheme", ["PIC", "FLIP"])
def test_linear_functions_do_not(scheme):
    assert column_error(16, kernel="linear", scheme=scheme)[0] > 0.5


@pytest.mark.parametrize("kernel", ["quadratic", "cubic"])
def test_boundary_splines_mend_the_wall(kernel):
    """The lowest cells carry what stands on them; uniform splines leave cell 0 half strained."""
    mended = column_error(16, kernel=kernel, boundary=True, scheme="FLIP")[1]
    plain = column_error(16, kernel=kernel, scheme="FLIP")[1]
    assert mended < 0.03 < 0.1 < plain


# ---- convergence --------------------------------------------------------------------------------


def box_error(n, dimension, **options):
    """Relative error of a standing wave in a unit box of n cells with slip walls, 0.7 periods on.

    u_a = A sin(π x_a) sin(ω t) along every axis a, ω = π c_p: the axes do not interact, and the
    amplitude of 1e-5 keeps the law linear. It starts from rest position, so that the staggering of
    symplectic Euler costs no first-order error in time. Fixed CFL.
    """
    modulus, ratio, density = 1e6, 0.3, 1000.0
    scene = libmpm.Scene(
        dimension=dimension, cell_size=1 / n, lower=(0,) * dimension, upper=(1,) * dimension,
        gravity=(0,) * dimension, method=Method(cfl=0.3),
    )  # fmt: skip
    scene.add_body(
        name="box",
        shape=shapes.Box(lower=(0,) * dimension, upper=(1,) * dimension),
        material=materials.FixedCorotated(
            density=density, youngs_modulus=modulus, poissons_ratio=ratio
        ),
        particles_per_cell=2**dimension,
    )
    scene.add_boundary(
        name="walls", shape=shapes.DomainWalls(faces="all"), response=boundaries.Slip()
    )
    spec = choose(scenes.specification(scene), **options)
    body = spec["bodies"][0]
    x = body["position"]
    p_wave = modulus * (1 - ratio) / (1 + ratio) / (1 - 2 * ratio)
    omega, amplitude = np.pi * np.sqrt(p_wave / density), 1e-5
    shape = np.sin(np.pi * x)
    body["velocity"] = amplitude * omega * shape
    machine = scenes.engine(spec)
    scenes.advance(machine, round(1.4 * np.pi / omega / machine.time_step))
    moved = scenes.by_id(machine, 0, "position") - x
    exact = amplitude * shape * np.sin(omega * machine.time)
    return np.linalg.norm(moved - exact) / np.linalg.norm(amplitude * shape)


def orders(sizes, dimension, **options):
    errors = [box_error(n, dimension, **options) for n in sizes]
    return [np.log(a / b) / np.log(2) for a, b in pairwise(errors)]


@pytest.mark.parametrize(
    "options",
    [{}, {"gradient": "kernel", "scheme": "FLIP"}, {"kernel": "cubic"}, {"kernel": "ugimp"},
     {"kernel": "linear", "scheme": "FLIP"}],
    ids=["default", "gradient", "cubic", "ugimp", "linear"],
)  # fmt: skip
def test_first_order_up_to_held_nodes(options):
    """Held nodes shorten the box by a fixed part of a cell (design/walls.md): first order."""
    assert min(orders((8, 16, 32), 2, **options)) > 1.0


@pytest.mark.parametrize(
    "options",
    [{"scheme": "FLIP"}, {"scheme": "FMPM", "order": 2}, {"scheme": "FLIP", "kernel": "linear"}],
    ids=["flip", "fmpm", "linear"],
)
def test_second_order_with_boundary_splines(options):
    """With functions that end at the wall nothing of first order is left."""
    assert min(orders((8, 16, 32), 2, boundary=True, **options)) > 1.9


def test_orders_in_3d():
    assert min(orders((6, 12), 3)) > 1.0
    assert min(orders((6, 12), 3, scheme="FLIP", boundary=True)) > 1.9


@pytest.mark.parametrize("precision", ["single", "double"])
def test_energies_are_those_of_the_fused_step(precision, device):
    """At every sample, also at those of the moment at which a run stops."""
    found = []
    for pipeline in ("auto", "phased"):
        scene = scenes.crowded(2)
        scene.add_sensor(name="energies", sensor=libmpm.sensors.Energy(interval=0.0))
        sim = libmpm.Simulation(scene, device=device, precision=precision, pipeline=pipeline)
        for _ in range(4):
            sim.step(5)
        found.append(np.asarray(sim.sensors["energies"].values))
    scale = np.abs(found[0]).max()
    assert found[0].shape == found[1].shape
    assert np.abs(found[0] - found[1]).max() < {"single": 1e-4, "double": 1e-11}[precision] * scale
