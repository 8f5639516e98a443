"""Theory beside rows of `contact.py` and `rigid.py`: a box afloat in a tank, let go above its rest.

Linear potential flow in the tank itself, in the plane: Laplace's equation by bilinear elements on
half of the tank, free surface linear about still water, walls, floor and sides of the box without
flow through them. With the potential φ = ψ on the surface and the box at w:

    M dη/dt = S ψ + w c        dψ/dt = -g η        (m + ρ a) dw/dt = -ρ g (B ζ + c·η)

η the surface, ζ the height of the box above rest, B its width, S the map from ψ to the flow through
the surface, c the flow there that a unit of w causes, ρ a the added mass of a surface that is as
good as weightless (high frequency). Without waves the half period is π √((m + ρ a) / ρ g B). Waves
make it shorter: they carry away what stands at the box in place of moving with it.

`added_mass` is that of DNV-RP-H103 (2011), table A-1, half a square, within 2 % where the tank is
wide: 0.593 B².
"""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import splu

Numbers = NDArray[np.float64]

G = 9.81


@functools.cache
def flow(
    draught: float, tank: float = 4.0, depth: float = 2.5, cells: int = 20
) -> tuple[Numbers, Numbers, Numbers, float]:
    """Return M, S, c and a for half of the tank, of a box 1 m wide, `cells` elements a metre."""
    h = 1.0 / cells
    across, high = round(tank / 2 * cells), round(depth * cells)
    half, low = round(0.5 * cells), high - round(draught * cells)
    number = np.arange((across + 1) * (high + 1)).reshape(across + 1, high + 1)
    i, j = (x.ravel() for x in np.meshgrid(range(across), range(high), indexing="ij"))
    wet = ~((i < half) & (j >= low))
    i, j = i[wet], j[wet]
    corner = np.stack(
        [number[i, j], number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]], axis=1
    )
    element = np.array([[4, -1, -2, -1], [-1, 4, -1, -2], [-2, -1, 4, -1], [-1, -2, -1, 4]]) / 6.0
    rows, columns = np.repeat(corner, 4, axis=1), np.tile(corner, (1, 4))
    values = np.tile(element.ravel(), (len(corner), 1))
    size = number.size
    stiffness = coo_matrix((values.ravel(), (rows.ravel(), columns.ravel())), (size, size)).tocsc()
    used = np.zeros(size, dtype=bool)
    used[corner.ravel()] = True
    surface = number[half:, high]
    inside = used.copy()
    inside[surface] = False
    inner = np.flatnonzero(inside)
    load = np.zeros(size)
    bottom = number[: half + 1, low]
    load[bottom] = h
    load[bottom[[0, -1]]] = 0.5 * h
    solve = splu(stiffness[inner][:, inner])
    between = stiffness[inner][:, surface]
    pushed = solve.solve(load[inner])
    mass = np.full(len(surface), h)
    mass[[0, -1]] = 0.5 * h
    schur = stiffness[surface][:, surface].toarray() - between.T @ solve.solve(between.toarray())
    return mass, np.asarray(schur), np.asarray(between.T @ pushed), float(load[inner] @ pushed)


def added_mass(draught: float, **tank: float) -> float:
    """Return a, m², of the whole box under a surface of no weight: over ρ its added mass."""
    return 2 * flow(draught, **tank)[3]  # type: ignore[arg-type]


def heave(
    ratio: float, lift: float, step: float = 0.002, until: float = 1.6, **tank: float
) -> dict[str, float]:
    """Return half period, s, and how far the lowest place is below rest, parts of the lift.

    `ratio` is density over water's, of a box 1 m by 1 m, `lift` m above where it floats in
    water of the same level. The tank's level rises as the box comes down.
    """
    mass, schur, flux, a = flow(ratio, **tank)  # type: ignore[arg-type]
    n = len(mass)
    matrix = np.zeros((2 * n + 2, 2 * n + 2))  # η, ψ, ζ, w of half of the tank
    matrix[:n, n : 2 * n] = schur / mass[:, None]
    matrix[:n, -1] = flux / mass
    matrix[n : 2 * n, :n] = -G * np.eye(n)
    matrix[-2, -1] = 1.0
    heavy = 0.5 * ratio + a
    matrix[-1, :n] = -G * flux / heavy
    matrix[-1, -2] = -G * 0.5 / heavy
    turn = expm(matrix * step)
    state = np.zeros(2 * n + 2)
    state[-2] = lift
    places = [lift]
    while len(places) * step < until:
        state = turn @ state
        places.append(state[-2])
    found = np.array(places)
    k = int(np.argmin(found))
    b = np.polyfit(np.arange(k - 3, k + 4) * step, found[k - 3 : k + 4], 2)
    width = tank.get("tank", 4.0)
    rest = lift / width  # of a box 1 m wide: level and box rise alike
    return {
        "half_period": float(-b[1] / (2 * b[0])),
        "overshoot": float((rest - found[k]) / lift),
        "simple": float(np.pi * np.sqrt((ratio + 2 * a) / G)),
    }
