"""Transfers: their numbers against the naive method, and what each loses and keeps.

Expected duration: 40 s.
"""
# ruff: noqa: F811  the fixture `device` is imported

import warnings

import numpy as np
import pytest

import libmpm
from libmpm import Method, materials, shapes
from support import scenes
from support.devices import device  # noqa: F401
from support.methods_reference import SCHEMES, MethodsReference, agree, choose

# ---- against the naive method -------------------------------------------------------------------


@pytest.mark.parametrize("every", [1, 3])
@pytest.mark.parametrize("order", [1, 2, 5])
@pytest.mark.parametrize("scheme", ["XPIC", "FMPM"])
def test_orders_and_due_steps(scheme, order, every, device):
    spec = choose(scenes.specification(scenes.crowded(2)), scheme, order=order, every=every)
    agree(spec, device, 20)


RULES = {
    "binary": {},
    "without guard": {"guard": False},
    "smooth": {"rule": "smooth", "critical_ratio": 0.999, "width": 0.002, "power": 3.0},
    "nothing below": {"rule": "smooth", "below": "zero", "width": 0.001},
}


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("scheme", ["SFLIP", "ASFLIP"])
def test_shift_rules(scheme, rule, device):
    spec = scenes.specification(scenes.crowded(2))
    choose(spec, scheme, flip=0.95, shift_max=0.25, shift_min=0.02, **RULES[rule])
    agree(spec, device, 20)


def test_guard_of_nflip(device):
    """Without it particles beside a wall move with what the wall has taken from their nodes."""
    found = []
    for guard in (True, False):
        spec = choose(scenes.specification(scenes.crowded(2)), "NFLIP", flip=0.9, guard=guard)
        found.append(scenes.by_id(agree(spec, device, 10)[0], 0, "position"))
    assert np.abs(found[0] - found[1]).max() > 1e-6


def test_bodies_with_their_own_numbers(device):
    spec = choose(scenes.specification(scenes.crowded(2)), "ASFLIP", flip=0.9)
    spec["bodies"][0]["transfer"] |= {"flip": 0.5, "shift_max": 0.1}
    spec["bodies"][1]["transfer"] |= {"flip": 1.0, "guard": False, "shift_min": 0.3}
    agree(spec, device, 20)


FORMS = ("one-volume", "one-volume-gradient", "two-volume", "stress-only", "split", "literal")


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("kernel", ["quadratic", "cubic"])
def test_forms_of_fbar(kernel, form, device):
    """On the water and on the solid, with an affine transfer that stores velocities."""
    spec = choose(scenes.specification(scenes.crowded(2)), "AFLIP", kernel, flip=0.9)
    for body, ratio in zip(spec["bodies"], (0.6, 0.3), strict=True):
        body["fbar"] = {"form": form, "time": 0.0, "ratio": ratio}
    agree(spec, device, 20)


@pytest.mark.parametrize("form", ["one-volume-gradient", "two-volume", "split"])
def test_forms_of_fbar_in_3d(form, device):
    spec = choose(scenes.specification(scenes.crowded(3)), "FLIP")
    for body in spec["bodies"]:
        body["fbar"] = {"form": form, "time": 0.0, "ratio": 0.5}
    agree(spec, device, 8)


# ---- momentum -----------------------------------------------------------------------------------


def spinning(scheme, kernel="quadratic", steps=200, **options):
    """Relative changes of momentum and of angular momentum about the centre in some steps."""
    spec = choose(scenes.specification(scenes.free_body(2)), scheme, kernel, **options)
    body = spec["bodies"][0]
    arm = body["position"] - body["position"].mean(axis=0)
    body["velocity"] = 8.0 * np.stack([-arm[:, 1], arm[:, 0]], axis=-1) + np.array([0.3, 0.2])
    machine = scenes.engine(spec)

    def sums():
        mass, velocity, x = (machine.grid(name) for name in ("mass", "velocity", "position"))
        r, p = x - mass @ x / mass.sum(), mass[:, None] * velocity
        return p.sum(axis=0), np.sum(r[:, 0] * p[:, 1] - r[:, 1] * p[:, 0])

    (p, spin), _ = sums(), scenes.advance(machine, steps)
    later, left = sums()
    return np.abs(later - p).max() / np.abs(p).max(), left / spin - 1


LOSSES = {  # of angular momentum, about three quarters of a turn; measured, ± a tenth of it
    "PIC": (-1.0, 0.02), "FLIP": (-0.25, 0.05), "PIC-FLIP": (-0.99, 0.02), "AFLIP": (0.13, 0.03),
    "NFLIP": (-0.30, 0.05), "SFLIP": (-0.99, 0.02), "ASFLIP": (0.13, 0.03), "XPIC": (-1.0, 0.02),
    "FMPM": (-1.0, 0.02),
}  # fmt: skip


@pytest.mark.parametrize("kernel", ["quadratic", "cubic"])
@pytest.mark.parametrize("gradient", ["mls", "kernel"])
def test_apic_conserves_angular_momentum(gradient, kernel):
    """Of the particles and of their affine velocities, whose second moment is the same anywhere."""
    momentum, spin = spinning("APIC", kernel, gradient=gradient)
    assert momentum < 1e-12
    assert abs(spin) < 1e-12


@pytest.mark.parametrize(("kernel", "most"), [("ugimp", 2e-3), ("cpgimp", 2e-3), ("cpdi", 8e-3)])
def test_apic_with_particles_of_a_size_nearly_does(kernel, most):
    """The second moment changes along a particle's way, and the affine part's share with it."""
    momentum, spin = spinning("APIC", kernel)
    assert momentum < 1e-12
    assert 1e-8 < abs(spin) < most


@pytest.mark.parametrize("kernel", ["cpdi", "ddmp"])
def test_forces_of_particle_and_dual_domains_add_up(kernel):
    """Also at a surface, where spans are empty: no force goes to a node without mass.

    Later the spinning body is torn by functions that are linear at its light nodes.
    """
    assert spinning("PIC-FLIP", kernel, steps=40, flip=0.9)[0] < 1e-12


@pytest.mark.parametrize("scheme", LOSSES)
def test_the_others_conserve_momentum_alone(scheme):
    """What the grid cannot see carries angular momentum that no transfer accounts for."""
    options = {"flip": 0.9} if scheme in ("PIC-FLIP", "AFLIP", "SFLIP", "ASFLIP") else {}
    if "SFLIP" in scheme:
        options["shift_max"] = 0.2
    momentum, spin = spinning(scheme, **options)
    assert momentum < 1e-12
    expected, margin = LOSSES[scheme]
    assert spin == pytest.approx(expected, abs=margin)


def test_every_scheme_is_tested():
    assert {*LOSSES, "APIC"} == set(SCHEMES)


# ---- dissipation --------------------------------------------------------------------------------


def strip(length, **method):
    """A solid strip of `length` x 2 cells of 1 m, four cells into an empty domain, c = 31.6 m/s."""
    scene = libmpm.Scene(
        dimension=2, cell_size=1.0, lower=(0, 0), upper=(length + 8, 10), gravity=(0, 0),
        method=Method(**method),
    )  # fmt: skip
    scene.add_body(
        name="strip",
        shape=shapes.Box(lower=(4, 4), upper=(4 + length, 6)),
        material=materials.FixedCorotated(density=1000.0, youngs_modulus=1e6, poissons_ratio=0.0),
        particles_per_cell=4,
    )
    return scenes.specification(scene)


def cycle_loss(wave, **options):
    """Part of a transverse mode of `wave` cells that one cycle takes away, in the strip's middle.

    The step is so short that neither forces nor motion matter. Read is the particles' velocity; in
    a mode every gathered or stored velocity shrinks alike, once the first cycles are over.
    """
    spec = choose(strip(4 * wave, time_step=1e-9), **options)
    body = spec["bodies"][0]
    x = body["position"][:, 0]
    k = 2 * np.pi / wave
    body["velocity"] = np.stack([np.zeros_like(x), np.sin(k * x)], axis=-1)
    middle = np.abs(x - x.mean()) < wave
    machine = scenes.engine(spec)

    def amplitude():
        velocity = scenes.by_id(machine, 0, "velocity")[middle, 1]
        return np.abs(velocity @ np.exp(1j * k * x[middle]))

    scenes.advance(machine, 3)
    first = amplitude()
    scenes.advance(machine, 8)
    return 1 - (amplitude() / first) ** (1 / 8)


# Coefficients and powers of k dx. With D the second moment PIC loses D (k dx)²: 1/4 of quadratic
# functions, 1/3 of cubic ones. What the affine part gives back leaves (k dx)⁴ / 40 and
# 17 (k dx)⁴ / 360, from the functions' transforms sin(k/2)/(k/2) to the third and fourth power.
# Blends lose the share 1 - alpha of it; order k of XPIC and FMPM the k-th power of what PIC loses.
LAWS = {
    "PIC": ({"scheme": "PIC"}, 1 / 4, 2),
    "PIC-FLIP 0.5": ({"scheme": "PIC-FLIP", "flip": 0.5}, 1 / 8, 2),
    "PIC-FLIP 0.95": ({"scheme": "PIC-FLIP", "flip": 0.95}, 1 / 80, 2),
    "APIC": ({"scheme": "APIC"}, 1 / 40, 4),
    "AFLIP 0.5": ({"scheme": "AFLIP", "flip": 0.5}, 1 / 80, 4),
    "AFLIP 0.95": ({"scheme": "AFLIP", "flip": 0.95}, 1 / 800, 4),
    "ASFLIP 0.95": ({"scheme": "ASFLIP", "flip": 0.95, "shift_max": 0.2}, 1 / 800, 4),
    "XPIC(2)": ({"scheme": "XPIC", "order": 2}, 1 / 16, 4),
    "FMPM(2)": ({"scheme": "FMPM", "order": 2}, 1 / 16, 4),
    "PIC cubic": ({"scheme": "PIC", "kernel": "cubic"}, 1 / 3, 2),
    "APIC cubic": ({"scheme": "APIC", "kernel": "cubic"}, 17 / 360, 4),
}


@pytest.mark.parametrize("wave", [8, 16, 32])
@pytest.mark.parametrize("law", LAWS)
def test_dissipation_of_one_cycle(law, wave):
    options, factor, power = LAWS[law]
    expected = factor * (2 * np.pi / wave) ** power
    assert cycle_loss(wave, **options) == pytest.approx(expected, rel=0.2)


@pytest.mark.parametrize("scheme", ["FLIP", "NFLIP"])
def test_flip_loses_nothing_without_forces(scheme):
    assert abs(cycle_loss(16, scheme=scheme)) < 1e-9


# Part of the energy of a longitudinal mode lost per step, in (k dx)⁴, at CFL 0.4: twice half of the
# damping of the velocity above. Where the stored velocity takes the acceleration as the particle
# sees it (FLIP, XPIC), but the grid meets it only filtered, forces lag by another
# (k dx)² / 4 · (ω dt)² = 0.04 (k dx)⁴.
BARS = {
    "APIC": ({"scheme": "APIC"}, 2, 1 / 40),
    "AFLIP": ({"scheme": "AFLIP", "flip": 0.5}, 2, 1 / 80),
    "FMPM(2)": ({"scheme": "FMPM", "order": 2}, 1, 1 / 16),
    "FLIP": ({"scheme": "FLIP"}, 1, 0.04),
    "XPIC(2)": ({"scheme": "XPIC", "order": 2}, 1, 1 / 16 + 0.04),
}


@pytest.mark.parametrize("bar", BARS)
def test_free_bar_over_a_hundred_periods(bar):
    """The energy of a mode of a bar of 24 cells falls as the law of one cycle says, ± 20 %."""
    options, mode, factor = BARS[bar]
    length, periods = 24, 100
    spec = choose(strip(length, cfl=0.4), **options)
    body = spec["bodies"][0]
    x = body["position"]
    k, c = mode * np.pi / length, np.sqrt(1e6 / 1000.0)
    shape = np.cos(k * (x[:, 0] - 4))
    body["velocity"] = 1e-4 * c * np.stack([shape, np.zeros_like(shape)], axis=-1)
    machine = scenes.engine(spec)
    steps = round(2 * length / mode / c / machine.time_step)

    def amplitude():
        found = []
        for _ in range(steps + 2):
            scenes.advance(machine, 1)
            found.append(shape @ (scenes.by_id(machine, 0, "position") - x)[:, 0])
        return np.abs(found).max()

    first = amplitude()
    scenes.advance(machine, (periods - 1) * steps - 2)
    kept = (amplitude() / first) ** 2
    expected = 1 - np.exp(-factor * k**4 * periods * steps)
    assert 0.1 < expected < 0.6
    assert 1 - kept == pytest.approx(expected, rel=0.2)


# ---- what the grid cannot see -------------------------------------------------------------------


def unseen(spec):
    """A velocity of the first body's particles, largest 1, that leaves no momentum at any node."""
    naive = MethodsReference(spec)
    s = naive.weights[0].matrix()
    _, size, vt = np.linalg.svd(s.T)
    null = vt[np.sum(size > 1e-10) :]
    assert len(null)  # there are more particles than nodes see
    v = np.zeros_like(naive.position[0])
    v[:, 0] = null[0] / np.abs(null[0]).max()
    return v


@pytest.mark.parametrize(
    ("options", "kept"),
    [({"scheme": "FLIP"}, 1.0), ({"scheme": "PIC-FLIP", "flip": 0.5}, 0.5), ({"scheme": "PIC"}, 0),
     ({"scheme": "XPIC", "order": 3}, 0), ({"scheme": "FMPM", "order": 3}, 0),
     ({"scheme": "XPIC", "order": 3, "every": 4}, 0),
     ({"scheme": "FMPM", "order": 3, "every": 4}, 0)],
)  # fmt: skip
def test_null_space(options, kept):
    """FLIP keeps what no node sees, blends their share a step, sweeps nothing once they are due."""
    spec = scenes.specification(scenes.free_body(2))
    body = spec["bodies"][0]
    place = (np.arange(20) + 0.5) / 5 * 0.1 + 0.6  # 25 particles a cell in four cells each way
    body["position"] = np.stack(np.meshgrid(place, place), -1).reshape(-1, 2)
    body["count"], body["particle_mass"] = 400, 800.0 * (0.1 / 5) ** 2
    spec["time_step"] = 1e-9
    v = unseen(choose(spec, **options))
    body["velocity"] = v
    machine = scenes.engine(spec)
    scenes.advance(machine, 1)
    assert scenes.by_id(machine, 0, "velocity") == pytest.approx(kept * v, abs=1e-6)


@pytest.mark.parametrize("scheme", ["XPIC", "FMPM"])
def test_steps_between_are_flip(scheme):
    """A mode that the grid sees hardly keeps its size until the next due step."""
    spec = choose(strip(64, time_step=1e-9), scheme, order=2, every=4)
    body = spec["bodies"][0]
    x = body["position"][:, 0]
    body["velocity"] = np.stack([np.zeros_like(x), np.sin(2 * np.pi / 8 * x)], axis=-1)
    machine = scenes.engine(spec)
    size = []
    for _ in range(9):
        scenes.advance(machine, 1)
        size.append(np.linalg.norm(scenes.by_id(machine, 0, "velocity")[80:-80]))
    change = 1 - np.array(size[1:]) / np.array(size[:-1])
    due = np.arange(1, 9) % 4 == 0
    assert change[due].min() > 0.01
    assert np.abs(change[~due]).max() < 1e-6


# ---- what moves by what the grid cannot see -----------------------------------------------------


def colliding_discs(transfer):
    scene = libmpm.Scene(
        dimension=2, cell_size=0.05, lower=(0, 0), upper=(1, 1), method=Method(transfer=transfer)
    )
    rubber = materials.NeoHookean(density=1000, youngs_modulus=1000, poissons_ratio=0.3)
    for name, centre, speed in (("left", 0.3, 0.1), ("right", 0.7, -0.1)):
        shape = shapes.Sphere(centre=(centre, centre), radius=0.2)
        scene.add_body(name=name, shape=shape, material=rubber, velocity=(speed, speed))
    scene.add_sensor(name="energy", sensor=libmpm.sensors.Energy(interval=0.1))
    return scene


TEARS = (
    libmpm.methods.Transfer(scheme="NFLIP"),
    libmpm.methods.Transfer(scheme="ASFLIP", flip=1.0, shift_max=0.5, shift_min=0.25),
)
HOLDS = (
    libmpm.methods.Transfer(scheme="FLIP"),
    libmpm.methods.Transfer(scheme="NFLIP", flip=0.9),
    libmpm.methods.Transfer(scheme="ASFLIP", flip=0.999, shift_max=1.0, shift_min=0.025),
    libmpm.methods.Transfer(scheme="SFLIP", flip=0.95, shift_max=1.0),
)


@pytest.mark.parametrize("transfer", TEARS + HOLDS, ids=lambda t: f"{t.scheme} {t.shift_min:g}")
def test_discs_that_collide_keep_their_particles_or_the_scene_says_so(transfer):
    """Sulsky, Chen and Schreyer (1994), four cells a radius: what tears is warned of."""
    scene = colliding_discs(transfer)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        simulation = libmpm.Simulation(scene, device="cpu", precision="double")
    warned = any("they tear" in str(w.message) for w in said)
    simulation.run(until=3.0, progress=False)
    reach = 0.0
    for name in ("left", "right"):
        x = simulation.particles[name]["position"]
        reach = max(reach, np.linalg.norm(x - np.median(x, axis=0), axis=1).max() / 0.2)
    total = np.asarray(simulation.sensors["energy"].values)[:, :3].sum(axis=1)
    torn = reach > 1.2
    assert torn == warned == (transfer in TEARS)
    assert (total[-1] / total[0] < 0.6) == torn


def test_water_may_move_by_what_the_grid_cannot_see():
    scene = libmpm.Scene(dimension=2, cell_size=0.05, lower=(0, 0), upper=(1, 1),
                         gravity=(0, -9.81), method=Method(
                             transfer=libmpm.methods.Transfer(scheme="NFLIP")))  # fmt: skip
    water = materials.TaitFluid(bulk_modulus=1e6)
    scene.add_body(name="water", shape=shapes.Box(lower=(0, 0), upper=(1, 0.5)), material=water)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene.validate()
