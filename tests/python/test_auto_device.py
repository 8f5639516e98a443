"""What `device="auto"` is: a CUDA device that has all of the scene, if there is one, or the CPU."""

from __future__ import annotations

import logging

import pytest

import libmpm
from libmpm import boundaries, contacts, grids, materials, methods, shapes
from libmpm._src.methods.transfer import KERNELS
from libmpm._src.run import backends
from libmpm._src.run.choices import built_for_cpu, choose_device
from libmpm._src.studies.study.study import _dealer

STEEL = materials.LinearElastic(density=1000.0, youngs_modulus=1e6, poissons_ratio=0.3)
RUBBER = materials.NeoHookean(density=1000.0, youngs_modulus=1e6, poissons_ratio=0.3)
BOX = shapes.Box(lower=(0.2, 0.2), upper=(0.6, 0.6))


@pytest.fixture
def device(monkeypatch):
    """A CUDA device that this machine need not have."""
    status = backends.CudaStatus(object(), ({"name": "a"},), "")
    monkeypatch.setattr(backends, "cuda_status", lambda: status)


def scene(kernel="quadratic", shape=BOX, material=STEEL, **body):
    made = libmpm.Scene(
        name="plate", dimension=2, cell_size=0.1, lower=(0, 0), upper=(1, 1), gravity=(0, -9.81),
        method=libmpm.Method(transfer="FLIP", kernel=kernel),
    )  # fmt: skip
    made.add_body(name="b", shape=shape, material=material, **body)
    return made


def touching():
    made = scene()
    beside = shapes.Box(lower=(0.6, 0.2), upper=(0.8, 0.6))
    made.add_body(name="c", shape=beside, material=STEEL)
    made.add_contact(name="joint", between=("b", "c"), law=contacts.Friction())
    return made


#: Name -> a scene, and what the CPU alone has of it.
SCENES = {
    **{
        f"kernel {name}": (
            lambda name=name: scene(name),
            f"kernel '{name}'" if name in ("cpdi", "ddmp") else "",
        )
        for name in KERNELS
    },
    "boundary splines": (lambda: scene(methods.Kernel(boundary=True)), ""),
    "kernel gradients": (lambda: scene(methods.Kernel(gradient="kernel")), ""),
    "modified": (
        lambda: scene(methods.Kernel(name="linear", modified=True)),
        "modified kernel 'linear'",
    ),
    "moved nodes": (
        lambda: scene(methods.Kernel(moved_nodes=True)),
        "kernel 'quadratic' by moved nodes",
    ),
    "assumed fields": (
        lambda: scene(assumed=methods.AssumedFields()),
        "body 'b' with assumed fields",
    ),
    "damping": (lambda: scene(damping=0.1), "body 'b' with numerical damping"),
    "placed force": (
        lambda: scene(
            force=boundaries.PlacedForce(axis="x", place=(0.0, 1.0), value=((1.0,) * 2,) * 2)
        ),
        "body 'b' with a placed force",
    ),
    "smoothing": (lambda: scene(smoothing=methods.Smoothing()), ""),
    "F-bar": (lambda: scene(material=RUBBER, fbar=methods.FBar(form="split", ratio=0.5)), ""),
    "elements, damped": (
        lambda: scene(
            shape=shapes.Triangles.box(lower=(0.2, 0.2), upper=(0.6, 0.6), edge=0.1),
            material=RUBBER,
            damping=0.1,
        ),
        "",
    ),
    "contacts": (touching, ""),
}


@pytest.mark.filterwarnings("ignore::libmpm.ModelWarning")
@pytest.mark.parametrize("name", SCENES)
def test_it_is_the_cpu_where_the_plan_for_cuda_refuses(name, device, caplog):
    make, alone = SCENES[name]
    made = make()
    assert built_for_cpu(made) == alone
    with caplog.at_level(logging.INFO, "libmpm"):
        plan = made.plan() if alone else None
    if alone:
        assert plan.device == "cpu"
        assert f"plate: on the CPU, as {alone} is not built for CUDA devices" in caplog.text
        with pytest.raises(libmpm.SceneError, match="built for"):
            made.plan(device="cuda")
        assert libmpm.Simulation(made).device == "cpu"
    else:
        assert made.plan().device == made.plan(device="cuda").device == "cuda:0"
        assert not caplog.text


def test_it_is_the_cpu_for_grids_of_functions(device, caplog):
    mesh = grids.Mesh.blocks(columns=2, rows=1, lower=(0.0, 0.0), upper=(2.0, 1.0))
    made = libmpm.Scene(grid=grids.TriangularGrid(mesh=mesh), name="sheet")
    with caplog.at_level(logging.INFO, "libmpm"):
        assert choose_device(made, "auto") == "cpu"
    assert "sheet: on the CPU, as a grid of functions is not built" in caplog.text
    with pytest.raises(libmpm.SceneError, match="built for the CPU alone"):
        choose_device(made, "cuda")


@pytest.mark.filterwarnings("ignore::libmpm.ModelWarning")
def test_nothing_is_said_without_a_device(monkeypatch, caplog):
    monkeypatch.setattr(backends, "cuda_status", lambda: backends.CudaStatus(None, (), "none"))
    with caplog.at_level(logging.INFO, "libmpm"):
        assert scene(damping=0.1).plan().device == scene().plan().device == "cpu"
    assert "on the CPU" not in caplog.text


def test_cases_of_a_study_are_dealt_what_has_them(device):
    class Item:
        def __init__(self, scene):
            self.what = self
            self.scene = scene

    deal = _dealer(object(), ["cuda:0", "cuda:1"], "auto")
    dealt = [deal(Item(made)) for made in (scene(), scene(damping=0.1), scene())]
    assert dealt == ["cuda:0", "auto", "cuda:1"]
    assert _dealer(object(), ["cuda:0"], "cuda:0")(Item(scene(damping=0.1))) == "cuda:0"
