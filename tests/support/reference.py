"""A naive dense material point method in NumPy, written from the equations and nothing else.

It takes the dictionary that the engine takes (see `design/engine-contract.md`) and keeps every
node of the domain in one dense array, with no sorting, blocks or packs. It is slow and meant to be
read beside the C++ code.
"""

import itertools

import numpy as np

PAD = 4  # nodes kept outside the domain on each side
FACES = ("x-", "x+", "y-", "y+", "z-", "z+")


def table_value(table, t):
    """Value of a time table at `t`: linear, with the end policies hold, repeat and zero."""
    time, value = np.array(table["time"], float), np.array(table["value"], float)
    if table["end"] == "zero" and t > time[-1]:
        return np.zeros(value.shape[1])
    if table["end"] == "repeat" and t > time[-1] and time[-1] > time[0]:
        t = time[0] + (t - time[0]) % (time[-1] - time[0])
    return np.array([np.interp(t, time, column) for column in value.T])


def lame(p):
    """Lamé's first parameter and the shear modulus."""
    e, nu = p["youngs_modulus"], p["poissons_ratio"]
    return e * nu / ((1 + nu) * (1 - 2 * nu)), e / (2 * (1 + nu))


def tait_pressure(j, bulk_modulus, exponent):
    return bulk_modulus / exponent * np.expm1(-exponent * np.log1p(-j))


def wave_speed(body):
    p = body["parameters"]
    if body["material"] == "TaitFluid":
        return np.sqrt(p["bulk_modulus"] / p["density"])
    lam, mu = lame(p)
    return np.sqrt((lam + 2 * mu) / p["density"])


def corotated_stress(h, p):
    """Kirchhoff stress of the fixed-corotated solid from H = F - I."""
    lam, mu = lame(p)
    d = h.shape[-1]
    f = h + np.eye(d)
    u, _, vt = np.linalg.svd(f)
    u[..., :, -1] *= np.sign(np.linalg.det(u @ vt))[..., None]
    trace = np.trace(h, axis1=-2, axis2=-1)
    second = 0.5 * (trace**2 - np.trace(h @ h, axis1=-2, axis2=-1))
    dilation = trace + second + (np.linalg.det(h) if d == 3 else 0.0)  # J - 1; in 2D det H = I2
    pressure_part = (lam * dilation * (1 + dilation))[..., None, None] * np.eye(d)
    return 2 * mu * (f - u @ vt) @ np.swapaxes(f, -1, -2) + pressure_part


def respond(v, wall_velocity, normal, response):
    """Velocities of constrained nodes after a wall with this outward normal has acted on them."""
    u = v - wall_velocity
    un = u @ normal
    if response["kind"] == "sticky":
        return np.broadcast_to(wall_velocity, v.shape).copy()
    active = un < 0 if response["kind"] == "separable" else np.ones(len(v), bool)
    tangential = u - un[:, None] * normal
    static, dynamic = response["static_friction"], response["dynamic_friction"]
    if static > 0 or dynamic > 0:
        a, size = np.maximum(0.0, -un), np.linalg.norm(tangential, axis=1)  # only where pressed
        slide = np.maximum(0.0, 1 - dynamic * a / np.where(size > 0, size, 1.0))
        tangential = tangential * np.where(size <= static * a, 0.0, slide)[:, None]
    return np.where(active[:, None], wall_velocity + tangential, v)


def constrained_nodes(boundary, cells, outside=0):
    """Masks over the padded grid for each face of a boundary, in the order of application.

    Domain walls hold the nodes from `outside` nodes beyond the outermost cell on.
    """
    index = np.meshgrid(*(np.arange(-PAD, n + PAD) for n in cells), indexing="ij")
    if boundary["kind"] == "domain":
        masks = {}
        for a, name in enumerate("xyz"[: len(cells)]):
            masks[name + "-"] = index[a] <= -outside
            masks[name + "+"] = index[a] >= cells[a] - 1 + outside
        return {face: mask for face, mask in masks.items() if face in boundary["faces"]}
    # Depth below each face, 0 in the cells next to it, -1 in the layer of cells around the box.
    lower, upper = boundary["lower"], boundary["upper"]
    depth = [d for i, lo, hi in zip(index, lower, upper, strict=True) for d in (i - lo, hi - 1 - i)]
    least = np.min(depth, axis=0)  # inside, every face at the least depth acts
    beside = sum(np.minimum(*depth[2 * a : 2 * a + 2]) < 0 for a in range(len(cells)))
    held = (least >= -1) & (beside <= 1)  # around it, only cells that share a face with it
    return {FACES[f]: (d == least) & held for f, d in enumerate(depth)}


class Reference:
    """State and step of the naive method. Bodies are indexed in the order of the scene."""

    outside = 0  # see `constrained_nodes`

    def __init__(self, spec):
        self.spec, self.d, self.dx = spec, spec["dimension"], float(spec["cell_size"])
        self.cells = list(spec["cells"])
        self.shape = tuple(n + 2 * PAD for n in self.cells)
        self.bodies = spec["bodies"]
        self.time, self.step_count = 0.0, 0
        stable = spec["cfl"] * self.dx / max(wave_speed(b) for b in self.bodies)
        self.fixed = spec.get("time_step")
        self.dt_limit = self.fixed or stable
        self.offsets = list(itertools.product((-1, 0, 1), repeat=self.d))
        self.masks = [constrained_nodes(b, self.cells, self.outside) for b in spec["boundaries"]]
        self.impulse = [{face: np.zeros(self.d) for face in m} for m in self.masks]
        keys = [repr([b["material"], *(sorted(b[k].items()) for k in ("parameters", "fbar"))])
                for b in self.bodies]  # fmt: skip
        self.group = [keys.index(k) for k in keys]
        self.position, self.j, self.jbar, self.h, self.mass = [], [], [], [], []
        moving = []
        for b in self.bodies:
            n, p = b["count"], b["parameters"]
            x = np.array(b["position"], float)
            self.position.append(x)
            self.mass.append(float(b["particle_mass"]))
            j = np.zeros(n)
            if b.get("pressure") is not None:
                ratio = p["exponent"] * np.asarray(b["pressure"], float) / p["bulk_modulus"]
                j = -np.expm1(-np.log1p(ratio) / p["exponent"])
            self.j.append(j)
            self.jbar.append(j.copy())
            self.h.append(np.zeros((n, self.d, self.d)))
            moving.append(np.broadcast_to(np.asarray(b["velocity"], float), (n, self.d)))
        self.dt = self._limited(max(np.abs(v).max() for v in moving))
        self._start(moving)

    def _start(self, moving):
        """Deposit the given velocities, without an affine part."""
        self._clear()
        for k, v in enumerate(moving):
            still = np.zeros((*v.shape, self.d))
            self._deposit(k, v, still, self.jbar[k], np.zeros_like(v), self.jbar[k])

    # ---- interpolation ----

    def _limited(self, speed):
        return min(self.dt_limit, 0.5 * self.dx / speed) if speed > 0 else self.dt_limit

    def _stencil(self, x):
        """For each of the 3^d nodes: its padded index, its weight and its distance x_i - x."""
        cell = np.floor(x / self.dx)
        xi = x / self.dx - (cell + 0.5)
        base = cell.astype(int) + PAD
        weight = {-1: 0.5 * (0.5 - xi) ** 2, 0: 0.75 - xi**2, 1: 0.5 * (0.5 + xi) ** 2}
        for k in self.offsets:
            n = np.prod([weight[k[a]][:, a] for a in range(self.d)], axis=0)
            yield tuple((base + k).T), n, (np.array(k) - xi) * self.dx

    def _clear(self):
        self.m = np.zeros(self.shape)
        self.momentum = np.zeros((*self.shape, self.d))
        self.group_mass = {g: np.zeros(self.shape) for g in self.group}
        self.group_j = {g: np.zeros(self.shape) for g in self.group}

    def _deposit(self, k, v, c, j_grid, j_slope, j_stress):
        """Add the sums of body `k`, the stress impulse of the coming step among the momentum."""
        mass, g = self.mass[k], self.group[k]
        factor = 4 * self.dt / (self.bodies[k]["parameters"]["density"] * self.dx**2)
        affine = c - factor * self._stress(k, c, j_stress)
        for node, n, r in self._stencil(self.position[k]):
            np.add.at(self.m, node, mass * n)
            local = v + np.einsum("nab,nb->na", affine, r)
            np.add.at(self.momentum, node, (mass * n)[:, None] * local)
            np.add.at(self.group_mass[g], node, mass * n)
            np.add.at(self.group_j[g], node, mass * n * (j_grid + np.sum(j_slope * r, axis=1)))

    def _stress(self, k, c, j):
        """Kirchhoff stress of every particle."""
        p = self.bodies[k]["parameters"]
        if self.bodies[k]["material"] != "TaitFluid":
            return corotated_stress(self.h[k], p)
        pressure = tait_pressure(j, p["bulk_modulus"], p["exponent"])
        viscous = p["viscosity"] * (c + np.swapaxes(c, 1, 2))
        return (1 - j)[:, None, None] * (viscous - pressure[:, None, None] * np.eye(self.d))

    # ---- one step ----

    def _grid_update(self):
        """Node velocities of the coming step and the momentum each boundary face takes out."""
        filled = self.m > 0
        v = np.zeros_like(self.momentum)
        v[filled] = self.momentum[filled] / self.m[filled][:, None]
        v[filled] += self.dt * table_value(self.spec["gravity"], self.time)
        return v, self._apply_boundaries(v)

    def _apply_boundaries(self, v):
        """Let the boundaries act on node velocities, in place; returns the momentum they take."""
        filled = self.m > 0
        taken = [{face: np.zeros(self.d) for face in m} for m in self.masks]
        for b, boundary in enumerate(self.spec["boundaries"]):
            if not boundary["start"] <= self.time < boundary["end"]:
                continue
            motion = boundary.get("velocity")
            wall = table_value(motion, self.time) if motion is not None else np.zeros(self.d)
            for face, mask in self.masks[b].items():
                normal = np.zeros(self.d)
                # It points into the fluid: inwards for domain walls, outwards for boxes.
                inwards = (face[1] == "+") == (boundary["kind"] == "domain")
                normal[FACES.index(face) // 2] = -1 if inwards else 1
                at = mask & filled
                before = v[at]
                v[at] = respond(before, wall, normal, boundary["faces"][face])
                taken[b][face] = np.sum(self.m[at][:, None] * (before - v[at]), axis=0)
        return taken

    def _gather(self, x, field):
        """Value and gradient of a node field at the particles."""
        value = gradient = 0.0
        for node, n, r in self._stencil(x):
            f = field[node]
            n = n.reshape(-1, *[1] * (f.ndim - 1))
            value = value + n * f
            r = 4 / self.dx**2 * r.reshape(len(r), *[1] * (f.ndim - 1), -1)
            gradient = gradient + (n * f)[..., None] * r
        return value, gradient

    def step(self):
        dt = self.dt
        v_node, taken = self._grid_update()
        j_node = {g: q / np.where(self.group_mass[g] > 0, self.group_mass[g], 1.0)
                  for g, q in self.group_j.items()}  # fmt: skip
        for total, part in zip(self.impulse, taken, strict=True):
            for face in part:
                total[face] = total[face] + part[face]
        self.dt = self._limited(np.abs(v_node).max())
        self._clear()
        for k in range(len(self.bodies)):
            v, c = self._gather(self.position[k], v_node)
            j_grid, slope, j_stress = self._advance(k, c, dt, j_node[self.group[k]])
            self.position[k] = self.position[k] + dt * v
            self._deposit(k, v, c, j_grid, slope, j_stress)
        self.time += dt
        self.step_count += 1

    def _advance(self, k, c, dt, j_node):
        """Advance what is stored; returns j for the grid, its slope and j for the stress."""
        x, fbar = self.position[k], self.bodies[k]["fbar"]
        zero = np.zeros_like(x)
        if self.bodies[k]["material"] != "TaitFluid":
            self.h[k] = self.h[k] + dt * (c + c @ self.h[k])
            return self.j[k], zero, self.j[k]
        rate = dt * np.trace(c, axis1=1, axis2=2)
        own = self.j[k] - rate * (1 - self.j[k])
        mean, slope = self._gather(x, j_node)
        mean = mean - rate * (1 - mean)
        psi = -np.expm1(-dt / fbar["time"]) if fbar["time"] > 0 else fbar["ratio"]
        mixed = (1 - psi) * own + psi * mean
        form = fbar["form"]
        self.j[k] = mixed if form in ("one-volume", "one-volume-gradient") else own
        self.jbar[k] = own if form == "none" else mixed
        if form == "stress-only":
            return own, zero, mixed
        return self.jbar[k], slope if form == "one-volume-gradient" else zero, self.jbar[k]

    def run(self, steps):
        for _ in range(steps):
            self.step()

    # ---- readers ----

    def velocity(self, k):
        """Velocity with which the coming step moves the particles of body `k`, and its gradient."""
        return self._gather(self.position[k], self._grid_update()[0])

    def totals(self):
        """Mass and momentum on the grid, before gravity and boundaries act."""
        return self.m.sum(), self.momentum.reshape(-1, self.d).sum(axis=0)
