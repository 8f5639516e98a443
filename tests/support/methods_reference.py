"""The naive method of `support.reference` with every transfer, kernel, gradient and F-bar form.

A kernel is a product over the axes. Along each axis it is kept as a dense matrix, particles times
nodes of the axis, so that gather and scatter are sums over all nodes of the domain and no stencil
appears anywhere.
"""

import numpy as np
from scipy.interpolate import BSpline

from support import scenes
from support.domains_reference import CornerWeights, DualWeights
from support.reference import PAD, Reference, corotated_stress, tait_pressure
from support.tolerances import REFERENCE

# ---- kernels of one axis, lengths in cells ------------------------------------------------------


def hat(r):
    return np.maximum(0.0, 1 - np.abs(r)), np.where(np.abs(r) < 1, -np.sign(r), 0.0)


def quadratic(r):
    a = np.abs(r)
    edge = np.maximum(0.0, 1.5 - a)
    inside = a < 0.5
    return np.where(inside, 0.75 - r**2, 0.5 * edge**2), np.where(
        inside, -2 * r, -np.sign(r) * edge
    )


def cubic(r):
    a = np.abs(r)
    edge = np.maximum(0.0, 2 - a)
    inside = a < 1
    value = np.where(inside, 2 / 3 - a**2 + a**3 / 2, edge**3 / 6)
    return value, np.sign(r) * np.where(inside, -2 * a + 1.5 * a**2, -(edge**2) / 2)


def gimp(r, half):
    """The mean of the hat over a particle that reaches `half` to either side."""

    def integral(s):
        s = np.clip(s, -1.0, 1.0)
        return s - 0.5 * s * np.abs(s)

    value = (integral(r + half) - integral(r - half)) / (2 * half)
    return value, (hat(r + half)[0] - hat(r - half)[0]) / (2 * half)


UNIFORM = {"linear": hat, "quadratic": quadratic, "cubic": cubic}
DEGREE = {"linear": 1, "quadratic": 2, "cubic": 3}


def knots(degree, cells):
    """Clamped knots over [0, cells]: inside, those of the uniform splines about cell centres."""
    inner = np.arange(1, cells) if degree == 2 else np.arange(cells) + 0.5
    return np.concatenate([np.zeros(degree + 1), inner, np.full(degree + 1, float(cells))])


def ghosts(degree):
    """Nodes outside the domain whose uniform spline reaches into it."""
    return 2 if degree == 3 else 1


def greville(degree, cells):
    """Abscissae with which the clamped splines reproduce a linear field, first ghost to last."""
    t = knots(degree, cells)
    return np.array([t[i + 1 : i + degree + 1].mean() for i in range(len(t) - degree - 1)])


def abscissae(kernel, cells):
    """Where the functions of an axis stand, in cells, with the padding."""
    lattice = np.arange(-PAD, cells + PAD) + 0.5
    if not kernel["boundary"]:
        return lattice
    degree = DEGREE[kernel["name"]]
    lattice[PAD - ghosts(degree) : len(lattice) - PAD + ghosts(degree)] = greville(degree, cells)
    return lattice


def axis_weights(name, x, cells, *, half=None, boundary=False):
    """Weights and their derivatives per cell of particles at `x`: (n, nodes) with the padding."""
    if not boundary:
        r = x[:, None] - (np.arange(-PAD, cells + PAD) + 0.5)
        return gimp(r, half[:, None]) if name in ("ugimp", "cpgimp") else UNIFORM[name](r)
    degree = DEGREE[name]
    basis = BSpline(knots(degree, cells), np.eye(cells + 2 * ghosts(degree)), degree)
    pad = PAD - ghosts(degree)
    return tuple(np.pad(f(x), ((0, 0), (pad, pad))) for f in (basis, basis.derivative()))


class Weights:
    """What lies between the particles at `x` (n, d) and all nodes.

    `value`, `slope` and `arm` hold per axis N, dN/dx and N (x_i - x), each (n, nodes of the axis).
    """

    def __init__(self, kernel, x, half, dx, cells):
        self.value, self.slope, self.arm = [], [], []
        self.moment = np.zeros_like(x)  # D_a = sum of N (x_i - x)_a^2
        for a, n in enumerate(cells):
            value, slope = axis_weights(
                kernel["name"], x[:, a] / dx, n, half=half[:, a], boundary=kernel["boundary"]
            )
            away = abscissae(kernel, n) * dx - x[:, a, None]
            self.value.append(value)
            self.slope.append(slope / dx)
            self.arm.append(value * away)
            self.moment[:, a] = np.sum(value * away**2, axis=1)

    def factors(self, along=None, kind="value"):
        """One matrix per axis: `kind` along one axis, N along the others."""
        return [getattr(self, kind)[a] if a == along else n for a, n in enumerate(self.value)]

    def gather(self, field, factors=None):
        """Sums over the nodes (..., c) -> (n, c), or (...) -> (n,)."""
        factors = factors or self.factors()
        f = field if field.ndim > len(factors) else field[..., None]
        out = np.einsum("pi,i...->p...", factors[0], f)  # particle, the other axes, component
        for w in factors[1:]:
            out = np.einsum("pi,pi...->p...", w, out)
        return out if field.ndim > len(factors) else out[:, 0]

    def scatter(self, q, factors=None):
        """Sums over the particles (n, c) -> (..., c), or (n,) -> (...)."""
        factors = factors or self.factors()
        out = q if q.ndim > 1 else q[:, None]
        for w in factors[:0:-1]:
            out = np.einsum("pi,p...->pi...", w, out)
        out = np.einsum("pi,p...->i...", factors[0], out)
        return out if q.ndim > 1 else out[..., 0]

    def matrix(self):
        """The dense matrix S of all weights, particles times nodes."""
        out = self.value[0]
        for w in self.value[1:]:
            out = (out[:, :, None] * w[:, None, :]).reshape(len(out), -1)
        return out

    def affine(self, field):
        """Slope of a node field by moments: the last axis is the direction."""
        rows = [self.gather(field, self.factors(a, "arm")) for a in range(len(self.value))]
        d = self.moment.reshape(len(self.moment), *[1] * (field.ndim - len(self.value)), -1)
        return np.stack(rows, axis=-1) / d

    def gradient(self, field, form):
        if form == "mls":
            return self.affine(field)
        rows = [self.gather(field, self.factors(a, "slope")) for a in range(len(self.value))]
        return np.stack(rows, axis=-1)

    def scatter_linear(self, mass, value, slope):
        """Sums of mass N (value + slope (x_i - x)); the last axis of the slope is the direction."""
        mass = mass if value.ndim == 1 else mass[:, None]
        out = self.scatter(mass * value)
        for a in range(len(self.value)):
            out = out + self.scatter(mass * slope[..., a], self.factors(a, "arm"))
        return out

    def force(self, tau, form):
        """Forces of the Kirchhoff stresses times volumes `tau`, (n, d, d)."""
        out = 0.0
        for a in range(len(self.value)):
            if form == "mls":
                part = tau[..., a] / self.moment[:, a, None]
                out = out - self.scatter(part, self.factors(a, "arm"))
            else:
                out = out - self.scatter(tau[..., a], self.factors(a, "slope"))
        return out


# ---- pieces of the step -------------------------------------------------------------------------


def full_mass(r, project, order):
    """The sum of (I - S+S)^m r over m < order, by residuals; `project` applies S+S."""
    out = np.zeros_like(r)
    for _ in range(order):
        out = out + r
        r = r - project(r)
    return out


def shift(loss, rule):
    """The share beta of r_p that moves the particle, by its volume loss 1 - J."""
    low, high = rule["shift_min"], rule["shift_max"]
    beyond = (1 - rule["critical_ratio"]) - loss  # J - J_c without the digits that J loses
    if rule["rule"] == "binary":
        return np.where(beyond > 0, high, low)
    grown = np.minimum((np.maximum(beyond, 0.0) / rule["width"]) ** rule["power"], 1.0)
    below = low if rule["below"] == "min" else 0.0
    return np.where(beyond < 0, below, low + (high - low) * grown)


def volume_loss(h):
    """1 - det(I + h)."""
    d = h.shape[-1]
    trace = np.trace(h, axis1=-2, axis2=-1)
    second = 0.5 * (trace**2 - np.trace(h @ h, axis1=-2, axis2=-1))
    return -(trace + second + (np.linalg.det(h) if d == 3 else 0.0))


ABSENT = {
    "flip": 1.0, "affine": True, "shift_max": 0.0, "shift_min": 0.0, "rule": "binary",
    "critical_ratio": 1.0, "width": 0.01, "power": 2, "below": "min", "guard": True,
}  # fmt: skip

KERNELS = ("linear", "quadratic", "cubic", "ugimp", "cpgimp")
#: Those whose functions are no products over the axes.
DOMAINS = ("cpdi", "ddmp")
SCHEMES = ("PIC", "FLIP", "PIC-FLIP", "APIC", "AFLIP", "NFLIP", "SFLIP", "ASFLIP", "XPIC", "FMPM")
AFFINE = ("APIC", "AFLIP", "ASFLIP")


def choose(spec, scheme="APIC", kernel="quadratic", *, gradient=None, boundary=False, order=2,
           every=1, flip=None, **shifts):  # fmt: skip
    """Give a specification these options, as the lowering of `Transfer` and `Kernel` does."""
    if gradient is None:
        smooth = kernel in ("quadratic", "cubic") and not boundary
        gradient = "mls" if smooth else "kernel"
    flip = 1.0 if flip is None else flip
    spec["kernel"] = {"name": kernel, "gradient": gradient, "boundary": boundary}
    spec["transfer"] = {"scheme": scheme, "order": order, "every": every}
    for body in spec["bodies"]:
        body["transfer"] = ABSENT | {"flip": flip, "affine": scheme in AFFINE} | shifts
    return spec


class MethodsReference(Reference):
    """State and step with the options `kernel` and `transfer` of the specification."""

    def __init__(self, spec):
        self.kernel = {"name": "quadratic", "gradient": "mls", "boundary": False}
        self.kernel |= spec.get("kernel", {})
        self.form = self.kernel["gradient"]
        transfer = {"scheme": "APIC", "order": 2, "every": 1} | spec.get("transfer", {})
        self.scheme, self.order, self.every = (transfer[k] for k in ("scheme", "order", "every"))
        self.transfer = [ABSENT | b.get("transfer", {}) for b in spec["bodies"]]
        if self.kernel["boundary"]:
            # Of the clamped functions only the outermost is not zero at the wall.
            self.outside = ghosts(DEGREE[self.kernel["name"]])
        super().__init__(spec)

    def _start(self, moving):
        self.v, self.half, self.edges, self.weights, self.volume = [], [], [], [], []
        for k, body in enumerate(self.bodies):
            volume = self.mass[k] / body["parameters"]["density"]
            self.volume.append(volume)
            self.half.append(np.full((body["count"], self.d), volume ** (1 / self.d) / 2 / self.dx))
            self.v.append(np.array(moving[k]))
            self.edges.append(np.broadcast_to(np.eye(self.d), (body["count"], self.d, self.d)))
            self.weights.append(self._weigh(k))
        self._occupy()
        self._clear()
        for k, x in enumerate(self.position):
            still = np.zeros((*x.shape, self.d))
            self._deposit(k, still, still, self.jbar[k], np.zeros_like(x), self.jbar[k])

    def _weigh(self, k):
        x, name = self.position[k], self.kernel["name"]
        if name == "cpdi":
            return CornerWeights(x, self.half[k][0, 0], self.edges[k], self.dx, self.cells)
        if name == "ddmp":
            return DualWeights(x, self.dx, self.cells)
        return Weights(self.kernel, x, self.half[k], self.dx, self.cells)

    def _occupy(self):
        """Gradients of the dual domain, once all bodies have their places."""
        if self.kernel["name"] == "ddmp":
            mass = sum(w.scatter(self._masses(k)) for k, w in enumerate(self.weights))
            for w in self.weights:
                w.occupy(mass)

    def _masses(self, k):
        return np.full(self.bodies[k]["count"], self.mass[k])

    def _clear(self):
        super()._clear()
        self.unstressed = np.zeros_like(self.momentum)

    def _deposit(self, k, c, gradient, j_grid, j_slope, j_stress):
        """Add the sums of body `k`; `c` is the affine part, `gradient` that of the velocity."""
        mass, g, w = self._masses(k), self.group[k], self.weights[k]
        self.m += w.scatter(mass)
        moved = w.scatter_linear(mass, self.v[k], c)
        tau = self._stress(k, gradient, j_stress)
        self.unstressed += moved
        self.momentum += moved + self.dt * w.force(self.volume[k] * tau, self.form)
        self.group_mass[g] += w.scatter(mass)
        self.group_j[g] += w.scatter_linear(mass, j_grid, j_slope)

    def _stress(self, k, gradient, j):
        p, fbar = self.bodies[k]["parameters"], self.bodies[k]["fbar"]["form"]
        if self.bodies[k]["material"] == "TaitFluid":
            pressure = tait_pressure(j, p["bulk_modulus"], p["exponent"])
            viscous = p["viscosity"] * (gradient + np.swapaxes(gradient, 1, 2))
            return (1 - j)[:, None, None] * (viscous - pressure[:, None, None] * np.eye(self.d))
        return corotated_stress(self.h[k] if fbar == "none" else self._scaled(self.h[k], j), p)

    def _scaled(self, h, j):
        """F - I of the deformation gradient with the volume loss `j` in place of its own."""
        s = np.expm1((np.log1p(-j) - np.log1p(-volume_loss(h))) / self.d)[:, None, None]
        return h + s * (np.eye(self.d) + h)

    # ---- one step ----

    def _project(self, r):
        """S+ S r: to the particles and back."""
        back = sum(
            w.scatter(self._masses(k)[:, None] * w.gather(r)) for k, w in enumerate(self.weights)
        )
        return self._per_mass(back)

    def _per_mass(self, q):
        return q / np.where(self.m > 0, self.m, 1.0)[..., None]

    def _due(self):
        return self.scheme in ("XPIC", "FMPM") and self.step_count % self.every == 0

    def _apply_boundaries(self, v):
        before = v.copy()
        taken = super()._apply_boundaries(v)
        self.changed = np.any(v != before, axis=-1)
        return taken

    def _grid_update(self):
        v, taken = super()._grid_update()
        if self.scheme == "FMPM" and self._due():
            v = full_mass(v, self._project, self.order)
            for total, part in zip(taken, self._apply_boundaries(v), strict=True):
                for face in part:
                    total[face] = total[face] + part[face]
        return v, taken

    def _averages(self):
        return {
            g: q / np.where(self.group_mass[g] > 0, self.group_mass[g], 1.0)
            for g, q in self.group_j.items()
        }

    def step(self):
        dt, bodies = self.dt, range(len(self.bodies))
        v, taken = self._grid_update()
        base = self._per_mass(self.unstressed)
        filtered = None
        if self.scheme == "XPIC" and self._due():
            filtered = full_mass(base, self._project, self.order)
        gradient = [w.gradient(v, self.form) for w in self.weights]
        affine = [w.affine(v) if self.transfer[k]["affine"] else np.zeros_like(gradient[k])
                  for k, w in enumerate(self.weights)]  # fmt: skip
        rate = [self._rate(k, dt * gradient[k]) for k in bodies]
        self._split(rate)
        j_node = self._averages()
        for total, part in zip(self.impulse, taken, strict=True):
            for face in part:
                total[face] = total[face] + part[face]
        advanced = [self._advance(k, gradient[k], dt, j_node[self.group[k]]) for k in bodies]
        for k, (_, _, j_stress) in enumerate(advanced):
            self.v[k], move = self._transfer(k, v, base, filtered, j_stress)
            self.position[k] = self.position[k] + dt * move
            if self.kernel["name"] == "cpgimp":
                self.half[k] = self.half[k] * (1 + dt * np.einsum("naa->na", gradient[k]))
            self.edges[k] = self.edges[k] + dt * gradient[k] @ self.edges[k]
            self.weights[k] = self._weigh(k)
        self._occupy()
        speed = np.abs(v).max(axis=-1)
        if self.form == "kernel":  # light nodes count by their weight in a velocity
            speed = speed * np.minimum(1, self.m / min(self.mass))
        self.dt = self._limited(speed.max())
        self._clear()
        for k, (j_grid, slope, j_stress) in enumerate(advanced):
            self._deposit(k, affine[k], gradient[k], j_grid, slope, j_stress)
        self.time += dt
        self.step_count += 1

    def _transfer(self, k, v, base, filtered, j):
        """New velocities of the particles of body `k` and the velocities that move them."""
        w, rule, own = self.weights[k], self.transfer[k], self.v[k]
        hat, bar = w.gather(v), w.gather(base)
        if self.scheme == "XPIC":
            smooth = own if filtered is None else w.gather(filtered)
            return smooth + hat - bar, hat - 0.5 * (hat - bar) - 0.5 * (own - smooth)
        if self.scheme == "FMPM" and self._due():
            return hat, hat
        if self.scheme in ("PIC", "APIC"):
            return hat, hat
        kept = rule["flip"] * (own - bar)
        if self.scheme not in ("NFLIP", "SFLIP", "ASFLIP"):
            return hat + kept, hat
        beta = shift(j, rule) if self.scheme != "NFLIP" else np.ones(len(j))
        if rule["guard"]:
            beta = np.where(w.gather(self.changed.astype(float)) > 0, 0.0, beta)
        return hat + kept, hat + beta[:, None] * kept

    # ---- volume ----

    def _rate(self, k, strain):
        """Relative change of volume in the step; a fluid takes its first order."""
        if self.bodies[k]["material"] == "TaitFluid":
            return np.trace(strain, axis1=1, axis2=2)
        return -volume_loss(strain)

    def _split(self, rate):
        """With the split form the average is of the volumes of this very step."""
        for g in set(self.group):
            if self.bodies[g]["fbar"]["form"] != "split":
                continue
            self.group_j[g] = 0.0
            for k, w in enumerate(self.weights):
                if self.group[k] == g:
                    trial = self.jbar[k] - rate[k] * (1 - self.jbar[k])
                    self.group_j[g] = self.group_j[g] + w.scatter(self._masses(k) * trial)

    def _advance(self, k, gradient, dt, j_node):
        """Advance what is stored; returns j for the grid, its slope and j for the stress."""
        fbar, form, w = self.bodies[k]["fbar"], self.bodies[k]["fbar"]["form"], self.weights[k]
        solid = self.bodies[k]["material"] != "TaitFluid"
        rate, zero = self._rate(k, dt * gradient), np.zeros_like(self.position[k])
        if solid:
            self.h[k] = self.h[k] + dt * (gradient + gradient @ self.h[k])
            own = volume_loss(self.h[k])
        else:
            own = self.j[k] - rate * (1 - self.j[k])
        mean = w.gather(j_node)
        if form not in ("split", "literal"):
            mean = mean - rate * (1 - mean)
        psi = -np.expm1(-dt / fbar["time"]) if fbar["time"] > 0 else fbar["ratio"]
        mixed = own if form == "none" else (1 - psi) * own + psi * mean
        slope = zero
        if form == "one-volume-gradient":
            slope = w.gradient(j_node, self.form)
        if form in ("one-volume", "one-volume-gradient"):
            own = mixed
            if solid:
                self.h[k] = self._scaled(self.h[k], mixed)
        self.j[k], self.jbar[k] = own, mixed
        if form == "stress-only":
            return own, zero, mixed
        if form == "literal":  # the grid averages the blend carried on by the rate just made
            return mixed - rate * (1 - mixed), zero, mixed
        return mixed, slope, mixed

    # ---- readers ----

    def velocity(self, k):
        v = self._grid_update()[0]
        return self.weights[k].gather(v), self.weights[k].gradient(v, self.form)


def agree(spec, device="cpu", steps=30):
    """Run the engine and the naive method; every stored quantity agrees to rounding."""
    machine, naive = scenes.engine(spec, device), MethodsReference(spec)
    # Readers give the velocity that a particle stores, where it stores one.
    stored = naive.scheme not in ("PIC", "APIC") and (naive.scheme, naive.every) != ("FMPM", 1)
    assert sum(body["count"] for body in spec["bodies"]) < 1000
    scenes.advance(machine, steps)
    naive.run(steps)
    assert abs(machine.time - naive.time) < 1e-12 * naive.time
    for k, body in enumerate(spec["bodies"]):
        position, velocity = (scenes.by_id(machine, k, name) for name in ("position", "velocity"))
        expected = naive.v[k] if stored else naive.velocity(k)[0]
        assert np.abs(position - naive.position[k]).max() < REFERENCE * naive.dx
        assert np.abs(velocity - expected).max() < REFERENCE * max(np.abs(expected).max(), 1e-3)
        if body["material"] == "TaitFluid":
            ratio = scenes.by_id(machine, k, "volume_ratio")
            assert np.abs(ratio - (1 - naive.j[k])).max() < REFERENCE
        else:
            gradient, h = scenes.by_id(machine, k, "deformation_gradient"), naive.h[k]
            if body["fbar"]["form"] in ("two-volume", "split", "literal"):  # that of the stress
                h = naive._scaled(h, naive.jbar[k])
            assert np.abs(gradient - np.eye(naive.d) - h).max() < REFERENCE
    return machine, naive
