"""Walls of linear cells, naively: every row of nodes before every face, one after the other.

Beside `support.reference`; derivation in `design/walls.md`, 7.
"""

import itertools

import numpy as np

from support.reference import FACES, PAD, Reference, respond, table_value, tait_pressure

FAR = 10**6


def is_linear(boundary, face):
    return bool(boundary["faces"].get(face, {}).get("linear"))


def plane_of(boundary, face, cells):
    """Axis, the cell whose lower side is the plane, and the sign of the normal into the water."""
    a, upper = FACES.index(face) // 2, face[1] == "+"
    if boundary["kind"] == "domain":
        return a, (cells[a] if upper else 0), (-1 if upper else 1)
    return a, boundary["upper" if upper else "lower"][a], (1 if upper else -1)


def rows_of(boundary, axis, cells):
    """For each other axis the cells whose rows end in the face, and those that it covers."""
    rows, covered = {}, {}
    for t, n in enumerate(cells):
        if t == axis:
            continue
        if boundary["kind"] == "domain":
            rows[t], covered[t] = (-FAR, FAR), (0, n)
            continue
        low, high = boundary["lower"][t], boundary["upper"][t]
        # Where the box ends with the domain its face goes on beyond.
        rows[t] = (-FAR if low <= 0 else low, FAR if high >= n else high)
        covered[t] = (max(low, 0), min(high, n))
    return rows, covered


def spline_integral(node, low, high):
    """Integral of the quadratic spline about the centre of a cell from `low` to `high`."""
    low, high = max(low, node - 1.0), min(high, node + 2.0)
    if low >= high:
        return 0.0
    total = 0.0
    # Three-point Gauss is exact for each of its pieces.
    for a, b in itertools.pairwise(
        sorted({low, high, *(k for k in (node, node + 1) if low < k < high)})
    ):
        for x, w in zip((-np.sqrt(0.6), 0.0, np.sqrt(0.6)), (5 / 18, 4 / 9, 5 / 18), strict=True):
            s = abs(0.5 * (a + b) + 0.5 * (b - a) * x - node - 0.5)
            total += w * (b - a) * (0.75 - s * s if s < 0.5 else 0.5 * (1.5 - s) ** 2)
    return total


class LinesReference(Reference):
    """`Reference` with linear faces; scenes without mirrors and surfaces."""

    def __init__(self, spec):
        super().__init__(spec)
        for boundary, masks in zip(spec["boundaries"], self.masks, strict=True):
            for face in masks:
                if is_linear(boundary, face):
                    masks[face] = self._deep(boundary, face)
        self.faces = []
        for b, boundary in enumerate(spec["boundaries"]):
            for face in filter(lambda f, b=boundary: is_linear(b, f), self.masks[b]):
                axis, plane, sign = plane_of(boundary, face, self.cells)
                rows, covered = rows_of(boundary, axis, self.cells)
                if boundary["kind"] == "box" and self._buried(b, axis, plane, sign, rows):
                    continue
                self.faces.append((b, face, axis, plane, sign, rows, covered))

    def _deep(self, boundary, face):
        """Nodes behind those of a line, which no particle before the wall reaches."""
        index = np.meshgrid(*(np.arange(-PAD, n + PAD) for n in self.cells), indexing="ij")
        a, plane, sign = plane_of(boundary, face, self.cells)
        if boundary["kind"] == "domain":
            return (index[a] < plane - 1) if sign > 0 else (index[a] > plane)
        depth = [
            d for i, lo, hi in zip(index, boundary["lower"], boundary["upper"], strict=True)
            for d in (i - lo, hi - 1 - i)
        ]  # fmt: skip
        least = np.min(depth, axis=0)
        return (depth[FACES.index(face)] == least) & (least >= 1)

    def _buried(self, b, axis, plane, sign, rows):
        """Whether a face lies beyond the domain, or in another box that goes on beyond its rows."""
        before = plane if sign > 0 else plane - 1
        for other in (o for k, o in enumerate(self.spec["boundaries"]) if k != b):
            if other["kind"] == "domain":
                if not 0 <= before < self.cells[axis]:
                    return True
                continue
            theirs, _ = rows_of(other, axis, self.cells)
            if other["lower"][axis] <= before < other["upper"][axis] and all(
                low <= rows[t][0] and high >= rows[t][1] for t, (low, high) in theirs.items()
            ):
                return True
        return False

    def _on_rows(self, rows, cell):
        return all(low <= cell[t] < high for t, (low, high) in rows.items())

    def _room(self, axis, plane, sign, cell):
        """Cells before the plane until another linear face on the same row."""
        rooms = [
            sign * (other - plane) for _, _, a, other, s, rows, _ in self.faces
            if a == axis and s != sign and self._on_rows(rows, cell)
        ]  # fmt: skip
        return min((r for r in rooms if r > 0), default=FAR)

    def _form(self, b, axis, plane, sign, cell):
        boundary, room = self.spec["boundaries"][b], self._room(axis, plane, sign, cell)
        thin = boundary["kind"] == "box" and boundary["upper"][axis] - boundary["lower"][axis] < 2
        return "held" if room < 2 or thin else "pair" if room < 4 else "linear"

    def _line_of(self, axis, cell):
        """Form and nodes of the line across an axis on which a node is, by the place on it."""
        for b, face, a, plane, sign, rows, _ in self.faces:
            if a != axis or not self._on_rows(rows, cell):
                continue
            place = cell[a] - plane if sign > 0 else plane - 1 - cell[a]
            form = self._form(b, axis, plane, sign, cell)
            if -1 <= place <= (1 if form == "linear" else 0):
                return b, face, sign, form, place
        return None

    def _pressure(self, node):
        """What the averaged fluids press at a node, times the part of it that they fill."""
        total = 0.0
        for g, mass in self.group_mass.items():
            body = self.bodies[self.group.index(g)]
            if body["material"] != "TaitFluid" or body["fbar"]["form"] == "none":
                continue
            p = body["parameters"]
            if mass[node] > 0:
                pressure = tait_pressure(
                    self.group_j[g][node] / mass[node], p["bulk_modulus"], p["exponent"]
                )
                total += max(0.0, pressure) * min(
                    1.0, mass[node] / (p["density"] * self.dx**self.d)
                )
        return total

    def _edges(self, v, taken):
        for b, face, axis, plane, sign, rows, covered in self.faces:
            boundary = self.spec["boundaries"][b]
            if boundary["kind"] != "box" or boundary["upper"][axis] - boundary["lower"][axis] < 2:
                continue
            ranges = [
                (plane - 1, plane) if t == axis else range(covered[t][0] - 2, covered[t][1] + 2)
                for t in range(self.d)
            ]  # fmt: skip
            for cell in itertools.product(*ranges):
                node = tuple(i + PAD for i in cell)
                if self._on_rows(rows, cell) or not self.m[node] > 0:
                    continue
                if self._line_of(axis, cell) is not None:
                    continue
                area = 0.5 * np.prod([spline_integral(cell[t], *covered[t]) for t in covered])
                push = sign * area * self.dx ** (self.d - 1) * self._pressure(node) * self.dt
                v[node][axis] += push / self.m[node]
                taken[b][face][axis] -= push

    def _apply_boundaries(self, v):
        taken = [{face: np.zeros(self.d) for face in m} for m in self.masks]
        self._edges(v, taken)
        free, bound, slides = v.copy(), np.zeros(v.shape, bool), []
        for node in map(tuple, np.argwhere(self.m > 0)):
            cell = tuple(i - PAD for i in node)
            for axis in range(self.d):
                found = self._line_of(axis, cell)
                if found is None:
                    continue
                b, face, sign, form, place = found
                self._hold(v, free, bound, slides, taken, node, axis, b, face, sign, form, place)
        for node, axis, b, face, change in slides:
            kept = ~bound[node]
            kept[axis] = False
            v[node][kept] -= change[kept]
            taken[b][face][kept] += self.m[node] * change[kept]
        for part, more in zip(taken, super()._apply_boundaries(v), strict=True):
            for face in part:
                part[face] = part[face] + more[face]
        return taken

    def _hold(self, v, free, bound, slides, taken, node, axis, b, face, sign, form, place):
        boundary = self.spec["boundaries"][b]
        law, motion = boundary["faces"][face], boundary.get("velocity")
        wall = table_value(motion, self.time) if motion is not None else np.zeros(self.d)

        def alone():
            before = v[node].copy()
            normal = np.zeros(self.d)
            normal[axis] = sign
            v[node] = respond(before[None], wall, normal, law)[0]
            taken[b][face] += self.m[node] * (before - v[node])

        if form == "held":
            return alone()
        shares = {1: 1.0, 0: 1 / 3, -1: -1 / 3} if form == "linear" else {0: 1.0, -1: -1.0}
        line = {}
        for k in shares:
            there = list(node)
            there[axis] += (k - place) * sign
            line[k] = tuple(there)
        m = np.array([self.m[line[k]] for k in shares])
        t = np.array(list(shares.values()))
        u = np.array([free[line[k]] - wall for k in shares])
        if not m[0] > m.sum() / 16:  # nothing leads: those at the plane stop there one by one
            return alone() if place <= 0 else None
        lead = np.sum(t * m * u[:, axis]) / np.sum(t * t * m)
        impulse = sign * np.sum(m * (t * lead - u[:, axis]))
        static, dynamic = law["static_friction"], law["dynamic_friction"]
        if law["kind"] == "separable" and not impulse > 0:
            onto = 0.5 * np.sum(u[-2:, axis]) if m[-2:].min() > 0 else 0.0  # in the plane
            if place <= 0 and sign * onto < 0:
                before = v[node].copy()
                v[node][axis] -= onto
                along = v[node] - wall
                along[axis] = 0.0
                speed = np.linalg.norm(along)
                if speed <= static * abs(onto):
                    v[node] -= along
                elif speed > 0:
                    v[node] -= min(1.0, dynamic * abs(onto) / speed) * along
                taken[b][face] += self.m[node] * (before - v[node])
            return None
        before = v[node][axis]
        v[node][axis] = wall[axis] + shares[place] * lead
        bound[node][axis] = True
        taken[b][face][axis] += self.m[node] * (before - v[node][axis])
        if static > 0 or dynamic > 0:
            mean = (m[:, None] * u).sum(axis=0) / m.sum()
            mean[axis] = 0.0
            speed, removed = np.linalg.norm(mean), max(0.0, impulse) / m.sum()
            lost = 1.0 if speed <= static * removed else min(1.0, dynamic * removed / speed)
            slides.append((node, axis, b, face, lost * mean))
