"""The plan, from a made-up answer of the engine."""

from __future__ import annotations

import json
import sys
import types
from typing import Any

import pytest

import libmpm
from libmpm._src.run import backends

RESULT: dict[str, Any] = {
    "bodies": [
        {
            "name": "water",
            "particles": 3000,
            "columns": [
                {"name": "position", "reals": 3, "bytes": 12},
                {"name": "j", "reals": 1, "bytes": 4},
                {"name": "C", "reals": 9, "bytes": 36},
                {"name": "id", "reals": 0, "bytes": 8},
            ],
            "bytes_per_particle": 60,
            "particle_spacing": 0.05,
        },
        {
            "name": "block",
            "particles": 96,
            "columns": [{"name": "H", "reals": 9, "bytes": 36}],
            "bytes_per_particle": 36,
            "particle_spacing": 0.05,
        },
    ],
    "grid": {"channels": ["mass", "momentum_x"], "bytes_per_node": 8},
    "pipeline": "fused",
    "pipeline_reason": "every material runs in it",
    "kernels": ["grid_update", "fused_step"],
    "time_step": 1e-4,
    "limited_by": "sound in <water>",
    "memory": {"particles": 2 << 20, "sort": 1024, "grid": 3 << 30, "tables": 12},
    "memory_total": (3 << 30) + (2 << 20) + 1036,
}


@pytest.fixture
def plan(scene: libmpm.Scene) -> libmpm.Plan:
    return libmpm.Plan(RESULT, scene=scene, until=0.25, threads=2)


def test_lookups(plan: libmpm.Plan) -> None:
    assert plan.columns("water") == ["position", "j", "C", "id"]
    assert plan.bytes_per_particle("block") == 36
    assert plan.channels == ["mass", "momentum_x"]
    assert plan.bytes_per_node == 8
    assert plan.kernels == ["grid_update", "fused_step"]
    assert plan.pipeline == "fused"
    assert plan.time_step == 1e-4
    assert plan.memory_total == RESULT["memory_total"]
    assert plan.bodies == ["water", "block"]
    with pytest.raises(libmpm.SceneError, match="did you mean 'water'"):
        plan.columns("watr")


def test_steps_and_cost(plan: libmpm.Plan, scene: libmpm.Scene) -> None:
    assert plan.steps == 2500
    assert plan.particle_steps == 2500 * 3096
    assert plan.seconds == pytest.approx(2500 * 3096 / plan.rate)
    open_ended = libmpm.Plan(RESULT, scene=scene)
    assert open_ended.steps is None
    assert open_ended.seconds is None
    with pytest.raises(libmpm.SceneError, match="until"):
        libmpm.Plan(RESULT, scene=scene, until=-1.0)


def test_text(plan: libmpm.Plan) -> None:
    text = str(plan)
    for words in ("small surge", "32 × 8 × 10 cells", "3,096", "3.002 GiB", "estimate", "pier"):
        assert words in text
    assert "2,500 to 0.25 s" in text
    lines = [line for line in text.splitlines() if not line.startswith("warning: ")]
    assert max(map(len, lines)) < 130


def test_ranks_need_more_for_particles_that_move(scene: libmpm.Scene) -> None:
    one, three = libmpm.Plan(RESULT, scene=scene), libmpm.Plan(RESULT, scene=scene, ranks=3)
    assert "migration" not in one.memory and one.memory_of_rank == one.memory_total
    own = sum(b["particles"] * b["bytes_per_particle"] for b in RESULT["bodies"])
    most = max(b["particles"] for b in RESULT["bodies"])
    # An eighth of all, and the one column that is copied, of 4 to 8 bytes a number.
    assert own / 8 + 4 * most <= three.memory["migration"] <= own / 8 + 9 * most + 1
    assert three.memory_total == one.memory_total + three.memory["migration"]
    assert three.memory_total <= 3 * three.memory_of_rank < three.memory_total + 3
    assert "on each of 3 ranks" in str(three)


def test_html_is_escaped(plan: libmpm.Plan) -> None:
    page = plan._repr_html_()
    assert page.count("<table>") == page.count("</table>") == 3
    assert "&lt;water&gt;" in page


def test_dictionary_is_plain(plan: libmpm.Plan) -> None:
    data = json.loads(json.dumps(plan.to_dict()))
    assert data["steps"] == 2500
    assert data["memory_total"] == plan.memory_total
    assert len(data["boundaries"]) == 12


def test_planes_show_stated_and_effective(tank: Any) -> None:
    scene = tank(lower=(10.0, 0.0), upper=(11.0, 1.0))
    scene.add_body(
        name="w",
        shape=libmpm.shapes.Box(lower=(10.0, 0.0), upper=(10.3, 0.5)),
        material=libmpm.materials.TaitFluid(),
    )
    scene.add_boundary(
        name="box",
        shape=libmpm.shapes.Box(lower=(10.52, 0.0), upper=(10.8, 2.0)),
        response=libmpm.boundaries.Slip(),
    )
    plan = libmpm.Plan(RESULT, scene=scene)
    left, right, bottom, top = plan.boundaries
    assert (left.face, left.stated) == ("x-", 10.52)
    assert left.effective == pytest.approx(10.5)
    assert left.shift == pytest.approx(-0.2)
    assert right.shift == pytest.approx(0.0, abs=1e-9)
    assert bottom.effective == 0.0
    assert top.effective == pytest.approx(2.0)
    assert len([w for w in plan.warnings if "boundary 'box'" in w]) == 1
    assert "-0.20 cells away" in str(plan)


def test_scene_plan_asks_for_the_kind_of_the_device(
    scene: libmpm.Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[dict[str, Any], str]] = []

    def answer(spec: dict[str, Any], kind: str) -> dict[str, Any]:
        asked.append((spec, kind))
        return RESULT

    core = types.ModuleType("libmpm._core")
    core.plan = answer
    monkeypatch.setitem(sys.modules, "libmpm._core", core)
    monkeypatch.setitem(sys.modules, "libmpm._cuda", None)
    # What was found is kept: neither this absence nor what other tests found may leak.
    absent = backends.CudaStatus(None, (), "not built")
    monkeypatch.setattr(backends, "cuda_status", lambda: absent)
    plan = scene.plan(device="cuda:1", precision="double", pipeline="two-pass", until=1.0)
    assert plan.device == "cuda:1"
    assert plan.steps == 10000
    ((spec, kind),) = asked
    assert kind == "cuda"
    assert (spec["device"], spec["precision"], spec["pipeline"]) == (1, "double", "two-pass")
    assert all(b["position"] is None and b["pressure"] is None for b in spec["bodies"])
    assert scene.plan().device == "cpu"


@pytest.mark.parametrize("device", ["gpu", "cuda:x", "cpu:1", ["cpu", "cuda"]])
def test_unknown_devices(device: Any) -> None:
    with pytest.raises(libmpm.DeviceError, match="device is"):
        backends.parse_device(device)


def test_device_names() -> None:
    assert backends.parse_device("cpu") == ("cpu", 0)
    assert backends.parse_device("cuda") == ("cuda", 0)
    assert backends.parse_device("cuda:3") == ("cuda", 3)
