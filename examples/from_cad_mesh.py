"""A structure from a CAD program: a surface mesh as STL becomes a rigid boundary with a load cell.

    python examples/from_cad_mesh.py [FILE.stl]

Without a file the script writes a wedge of its own, a bridge pier with a sharp nose. STL, OBJ, PLY,
gmsh, Abaqus and VTK files are read. The cells are coarse, so that it takes half a minute: three
warnings say what the load lacks for it, and with which cells it would not.
"""

import sys
from pathlib import Path

import meshio
import numpy as np

import libmpm
from libmpm import boundaries, materials, sensors, shapes


def write_pier(path: Path) -> None:
    """Write a pier 0.4 m long and 0.2 m wide whose nose points against the flow."""
    plan = np.array([(1.2, 0.4), (1.35, 0.3), (1.6, 0.3), (1.6, 0.5), (1.35, 0.5)])
    n = len(plan)
    points = np.array([(x, y, z) for z in (-0.1, 0.5) for x, y in plan])
    sides = [t for k in range(n) for j in [(k + 1) % n] for t in ((k, j, n + j), (k, n + j, n + k))]
    caps = [t for k in range(1, n - 1) for t in ((0, k + 1, k), (n, n + k, n + k + 1))]
    meshio.write(path, meshio.Mesh(points, [("triangle", np.array(sides + caps))]))


def scene(path: Path) -> libmpm.Scene:
    """Return a dam break that the structure in a file divides."""
    made = libmpm.Scene(
        cell_size=0.05, lower=(0, 0, 0), upper=(2, 0.8, 0.6), gravity=(0, 0, -9.81), name="pier"
    )
    made.add_body(
        name="water",
        shape=shapes.Box(lower=(0, 0, 0), upper=(0.8, 0.8, 0.4)),
        material=materials.TaitFluid(density=1000, bulk_modulus=4e5),
        hydrostatic=0.4,
    )
    free = boundaries.Separable()
    made.add_boundary(name="walls", shape=shapes.DomainWalls(), response=free)
    made.add_boundary(name="pier", shape=shapes.SurfaceMesh(file=path), response=free)
    made.add_sensor(name="load", sensor=sensors.LoadCell(boundary="pier", interval=2e-3))
    return made


if __name__ == "__main__":
    if len(sys.argv) > 1:
        file = Path(sys.argv[1])
    else:
        file = Path("pier.stl")
        write_pier(file)
    sim = libmpm.Simulation(scene(file))
    sim.run(until=0.8)
    peak = sim.sensors["load"].peak("force_x", filter=0.01)
    print(f"largest force along the flow {peak.value:.0f} N at {peak.time:.2f} s")
    sim.plot("speed", planes="3d").savefig("from_cad_mesh.png", dpi=150)
