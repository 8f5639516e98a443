"""Frames of bodies of elements: unstructured grids that VTK and libmpm read alike."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from libmpm import shapes
from libmpm._src.output.export import Picture, _csv, _npz
from libmpm._src.output.frames import read_frame, write_frame
from libmpm._src.output.results import Frame
from libmpm._src.output.settings import Output

ABOUT = {"time": 0.25, "step": 3, "body": "bar", "index": 1, "precision": "double", "version": "t"}


def mesh_of(d: int) -> Any:
    kind: Any = shapes.Triangles if d == 2 else shapes.Tetrahedra
    return kind.box(lower=(0,) * d, upper=(1.0, 0.5, 0.5)[:d], edge=0.25)


def arrays_of(mesh: Any) -> dict[str, np.ndarray[Any, Any]]:
    rng = np.random.default_rng(1)
    n, m, d = mesh.count, len(mesh.elements), mesh.dimension
    return {
        "velocity": rng.normal(size=(n, d)),
        "pressure": rng.normal(size=n),
        "element_stress": rng.normal(size=(m, d, d)),
        "element_volume_ratio": rng.normal(size=m),
    }


@pytest.mark.parametrize("d", [2, 3])
def test_a_frame_comes_back(d: int, tmp_path: Path) -> None:
    mesh = mesh_of(d)
    arrays = arrays_of(mesh)
    path = tmp_path / "bar_000001.vtkhdf"
    write_frame(path, mesh.vertices, arrays, ABOUT, elements=mesh.rows())
    frame = Frame(path, d)
    assert frame.count == mesh.count
    assert frame.elements is not None and np.array_equal(frame.elements, mesh.elements)
    assert np.array_equal(frame["position"], mesh.vertices)
    for name, array in arrays.items():
        assert np.array_equal(frame[name], array)
    assert frame.units["element_stress"] == "Pa" and frame.units["element_volume_ratio"] == "1"
    assert set(read_frame(path)[0]) == {"position", *arrays}


@pytest.mark.parametrize("d", [2, 3])
def test_vtk_reads_it_as_a_grid(d: int, tmp_path: Path) -> None:
    reader_of = pytest.importorskip("vtkmodules.vtkIOHDF").vtkHDFReader
    numpy_of = pytest.importorskip("vtkmodules.util.numpy_support").vtk_to_numpy
    mesh = mesh_of(d)
    arrays = arrays_of(mesh)
    path = tmp_path / "bar_000001.vtkhdf"
    write_frame(path, mesh.vertices, arrays, ABOUT, elements=mesh.rows())
    reader = reader_of()
    reader.SetFileName(str(path))
    reader.Update()
    grid = reader.GetOutput()
    assert grid.GetClassName() == "vtkUnstructuredGrid"
    assert grid.GetNumberOfCells() == len(mesh.elements)
    assert grid.GetCell(0).GetClassName() == ("vtkTriangle" if d == 2 else "vtkTetra")
    corners = [grid.GetCell(5).GetPointId(i) for i in range(d + 1)]
    assert corners == mesh.elements[5].tolist()
    stress = numpy_of(grid.GetCellData().GetArray("element_stress"))
    assert np.array_equal(stress.reshape(-1, d, d), arrays["element_stress"])
    assert np.array_equal(numpy_of(grid.GetPointData().GetArray("pressure")), arrays["pressure"])


def test_particles_have_no_elements(tmp_path: Path) -> None:
    path = tmp_path / "water_000001.vtkhdf"
    write_frame(path, np.zeros((4, 3)), {"pressure": np.zeros(4)}, ABOUT)
    assert Frame(path, 3).elements is None


def test_other_formats(tmp_path: Path) -> None:
    mesh = mesh_of(3)
    arrays = {"position": mesh.vertices, **arrays_of(mesh)}
    units = {"element_stress": "Pa"}
    picture = Picture(arrays, units, ABOUT, mesh.rows())
    path = _csv(tmp_path, picture)
    head, first = path.read_text().splitlines()[:2]
    assert head.startswith("position_x,") and "element" not in head
    assert len(first.split(",")) == 7
    cells = path.with_suffix(".elements.csv").read_text().splitlines()
    assert cells[0].startswith("vertex_0,vertex_1,vertex_2,vertex_3,element_stress_xx [Pa]")
    assert len(cells) == 1 + len(mesh.elements)
    with np.load(_npz(tmp_path, picture)) as archive:
        assert np.array_equal(archive["elements"], mesh.elements)
        assert np.array_equal(archive["element_stress"], arrays["element_stress"])


def test_what_frames_hold_by_default(tmp_path: Path) -> None:
    output = Output(tmp_path, frame_interval=1)
    assert output.attributes_of("bar") == ["velocity", "pressure"]
    assert output.attributes_of("bar", meshed=True) == [
        "velocity", "pressure", "element_stress", "element_volume_ratio",
    ]  # fmt: skip
    chosen = Output(tmp_path, frame_interval=1, attributes={"bar": ["element_energy"]})
    assert chosen.attributes_of("bar", meshed=True) == ["element_energy"]
