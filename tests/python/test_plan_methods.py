"""What a transfer, kernel or form of F-bar adds to a scene that asks for it, and to no other."""

from typing import Any

import pytest

import libmpm
from libmpm.methods import Kernel, Transfer


def plan(
    dimension: int = 3, fbar: Any = None, solid: bool = False, pipeline: str = "auto", **method: Any
) -> libmpm.Plan:
    scene = libmpm.Scene(
        dimension=dimension,
        cell_size=0.1,
        lower=(0.0,) * dimension,
        upper=(1.6,) * dimension,
        method=libmpm.Method(**method),
    )
    elastic = libmpm.materials.FixedCorotated(density=1000.0, youngs_modulus=1e6)
    scene.add_body(
        name="body",
        shape=libmpm.shapes.Box(lower=(0.0,) * dimension, upper=(0.8,) * dimension),
        material=elastic if solid else libmpm.materials.TaitFluid(bulk_modulus=1e5),
        fbar=fbar,
    )
    return scene.plan(device="cpu", precision="double", pipeline=pipeline)


def extra(other: libmpm.Plan, base: libmpm.Plan) -> set[str]:
    """Columns that one plan has and the other has not."""
    return set(other.columns("body")) - set(base.columns("body"))


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_default_method_stores_nothing_of_the_others(dimension: int) -> None:
    base = plan(dimension)
    assert base.pipeline == "fused"
    assert base.columns("body") == ["position", "j", "id"]
    assert base.bytes_per_particle("body") == 8 * (dimension + 1) + 4
    # Twice mass and momentum, once the velocity.
    assert base.bytes_per_node == 8 * (2 * (1 + dimension) + dimension)


@pytest.mark.parametrize("scheme", ["PIC", "FMPM"])
def test_transfers_that_keep_nothing_store_no_velocity(scheme: str) -> None:
    found = plan(transfer=scheme)
    assert extra(found, plan()) == {"deposit"}
    assert not any(c.startswith("plain") for c in found.channels)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize(
    "transfer",
    [
        Transfer(scheme="FLIP"),
        Transfer(scheme="AFLIP", flip=0.9),
        Transfer(scheme="XPIC", order=3),
        Transfer(scheme="FMPM", order=3, every=4),
    ],
)
def test_transfers_that_keep_a_velocity_store_one(dimension: int, transfer: Transfer) -> None:
    base = plan(dimension, pipeline="phased")
    found = plan(dimension, transfer=transfer)
    assert "velocity" in extra(found, base)
    plain = [c for c in found.channels if c.startswith("plain_momentum")]
    assert len(plain) == dimension
    assert set(found.channels) - set(plain) == set(base.channels)


def test_a_guard_costs_only_where_a_rule_is_guarded() -> None:
    rule = {"scheme": "ASFLIP", "flip": 0.9, "shift_max": 0.1}
    free = plan(2, transfer=Transfer(**rule, guard=False))
    guarded = plan(2, transfer=Transfer(**rule))
    blend = plan(2, transfer=Transfer(scheme="AFLIP", flip=0.9))
    assert free.bytes_per_node == blend.bytes_per_node
    assert guarded.bytes_per_node == free.bytes_per_node + 8


def test_only_cpgimp_stores_a_stretch() -> None:
    base = plan(pipeline="phased")
    assert extra(plan(kernel="cubic"), base) == set()
    assert extra(plan(kernel="ugimp"), base) == set()
    assert extra(plan(kernel="cpgimp"), base) == {"stretch"}
    assert plan(kernel="cubic").bytes_per_node == base.bytes_per_node


def test_only_cpdi_stores_edges_and_only_where_the_law_stores_no_gradient() -> None:
    fluid, solid = plan(pipeline="phased"), plan(pipeline="phased", solid=True)
    assert extra(plan(kernel="cpdi"), fluid) == {"edges"}
    assert extra(plan(kernel="cpdi", solid=True), solid) == set()
    assert extra(plan(kernel="ddmp", transfer="PIC"), fluid) == set()
    for kernel, transfer in (("cpdi", "APIC"), ("ddmp", "PIC")):
        found = plan(kernel=kernel, transfer=transfer)
        assert (found.bytes_per_node, found.channels) == (fluid.bytes_per_node, fluid.channels)


def test_fbar_on_a_solid_is_off_unless_given() -> None:
    assert plan(solid=True, fbar="default").pipeline == "fused"
    one = plan(solid=True, fbar=libmpm.FBar())
    two = plan(solid=True, fbar=libmpm.FBar(form="split", ratio=0.9))
    none = plan(solid=True, pipeline="phased")
    assert one.pipeline == two.pipeline == "phased"
    assert extra(one, none) == set()
    assert extra(two, none) == {"j_smoothed"}


def test_a_pipeline_that_has_not_what_the_scene_asks_for_is_refused() -> None:
    with pytest.raises(libmpm.SceneError, match=r"pipeline 'fused' .* Use pipeline=\"auto\""):
        plan(kernel="cubic", pipeline="fused")
    with pytest.raises(libmpm.SceneError, match="pipeline 'two-pass'"):
        plan(transfer="PIC", pipeline="two-pass")


@pytest.mark.parametrize(
    ("method", "words"),
    [
        ({"kernel": "linear"}, ["APIC", "kernel 'linear'", "another kernel"]),
        (
            {"kernel": Kernel(boundary=True), "transfer": Transfer(scheme="AFLIP", flip=0.9)},
            ["AFLIP", "quadratic boundary splines", "another kernel"],
        ),
        ({"kernel": "hat"}, ["kernel is 'hat'", "linear, quadratic, cubic"]),
        ({"transfer": "PIC-FLIP"}, ["PIC-FLIP", "flip="]),
        ({"transfer": "APICC"}, ["did you mean 'APIC'"]),
    ],
)
def test_undefined_methods_are_refused_by_name(method: dict[str, Any], words: list[str]) -> None:
    with pytest.raises(libmpm.SceneError) as caught:
        libmpm.Method(**method)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        ({"scheme": "AFLIP"}, ["AFLIP", "without flip"]),
        ({"scheme": "APIC", "flip": 0.5}, ["flip is 0.5", "'APIC'"]),
        ({"scheme": "FLIP", "shift_max": 0.1}, ["shift_max", "SFLIP and ASFLIP"]),
        (
            {"scheme": "SFLIP", "flip": 1.0, "shift_max": 0.1, "shift_min": 0.2},
            ["shift_min is 0.2 above shift_max 0.1"],
        ),
        ({"scheme": "PIC", "order": 3}, ["order is 3", "XPIC and FMPM"]),
        ({"scheme": "XPIC", "order": 0}, ["order"]),
    ],
)
def test_numbers_that_do_not_belong_to_a_scheme_are_refused(
    numbers: dict[str, Any], words: list[str]
) -> None:
    with pytest.raises(libmpm.SceneError) as caught:
        Transfer(**numbers)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    "kernel",
    [{"name": "linear", "gradient": "mls"}, {"boundary": True, "gradient": "mls"},
     {"name": "ugimp", "boundary": True}],
)  # fmt: skip
def test_kernels_that_are_undefined_are_refused(kernel: dict[str, Any]) -> None:
    with pytest.raises(libmpm.SceneError, match=r"zero at their nodes|linear, quadratic or cubic"):
        Kernel(**kernel)


def test_a_body_has_the_scenes_scheme_with_numbers_of_its_own() -> None:
    def scene(own: Transfer) -> libmpm.Scene:
        made = libmpm.Scene(
            dimension=2, cell_size=0.1, lower=(0, 0), upper=(1, 1),
            method=libmpm.Method(transfer=Transfer(scheme="PIC-FLIP", flip=0.9)),
        )  # fmt: skip
        made.add_body(
            name="body", shape=libmpm.shapes.Box(lower=(0.2, 0.2), upper=(0.8, 0.8)),
            material=libmpm.materials.TaitFluid(bulk_modulus=1e5), transfer=own,
        )  # fmt: skip
        return made

    scene(Transfer(scheme="PIC-FLIP", flip=0.5)).validate()
    with pytest.raises(libmpm.SceneError, match="body 'body': transfer is 'FLIP' in a scene with"):
        scene(Transfer(scheme="FLIP")).validate()


def test_methods_go_through_a_file(tmp_path: Any) -> None:
    scene = libmpm.Scene(
        dimension=2, cell_size=0.1, lower=(0, 0), upper=(1, 1),
        method=libmpm.Method(
            transfer=Transfer(scheme="ASFLIP", flip=0.99, shift_max=0.1, shift_rule="smooth"),
            kernel=Kernel(name="cubic", gradient="kernel"),
        ),
    )  # fmt: skip
    scene.save(tmp_path / "scene.json")
    assert libmpm.Scene.load(tmp_path / "scene.json") == scene
