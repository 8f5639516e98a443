"""A stand-in for the compiled module: enough of its seam to test files and the run loop quickly.

Particles fall and bounce on the floor; every number is a plain function of the step, so runs can
be compared bit by bit. `install` puts it in the place of `libmpm._core`.
"""

from __future__ import annotations

import sys
import time
import types

import numpy as np

_UNITS = {
    "load-cell": (["force_x", "force_y", "force_z"], ["N", "N", "N"]),
    "wave-gauge": (["level"], ["m"]),
    "velocity-probe": (["velocity_x", "velocity_y", "velocity_z"], ["m/s"] * 3),
    "energy": (["kinetic", "elastic", "potential", "dissipated"], ["J"] * 4),
}


class Engine:
    """Falling particles behind the engine's seam; `delay` makes steps slow."""

    delay = 0.0
    fail_at = -1
    leave_at = -1

    def __init__(self, spec):
        self._spec = spec
        self._bodies = []
        rng = np.random.default_rng(0)
        for body in spec["bodies"]:
            order = rng.permutation(body["count"])
            position = body["position"](0, body["count"])[order]
            velocity = np.broadcast_to(np.array(body["velocity"]), position.shape).copy()
            ids = np.arange(body["count"], dtype=np.uint64) + np.uint64(body["first_id"])
            self._bodies.append({"id": ids[order], "position": position, "velocity": velocity})
        self.time_step = spec["time_step"] or 1e-3
        self.time = 0.0
        self.step = 0
        self._pending = [([], []) for _ in spec["sensors"]]
        self._last = [0] * len(spec["sensors"])
        self._removed = []

    def particle_count(self, body):
        return len(self._bodies[body]["id"])

    def condition(self, _samples):
        return {
            "kinetic": 0.0, "elastic": 0.0, "potential": 0.0, "mass": 0.0, "speed": 0.0,
            "density": 0.0, "volume_ratio": [1.0] * len(self._bodies),
        }  # fmt: skip

    def sensor_columns(self, i):
        sensor = self._spec["sensors"][i]
        d = self._spec["dimension"]
        if sensor["kind"] == "tracker":
            names = [f"{q}_{a}:{i}" for i in sensor["ids"] for q in ("position", "velocity")
                     for a in "xyz"[:d]]  # fmt: skip
            return names, ["m" if n.startswith("position") else "m/s" for n in names]
        names, units = _UNITS[sensor["kind"]]
        if sensor["kind"] in ("load-cell", "velocity-probe"):
            return names[:d], units[:d]
        return list(names), list(units)

    def _sample(self, i):
        width = len(self.sensor_columns(i)[0])
        return np.sin(self.time * (np.arange(width) + 1.0)) + i

    def _advance(self):
        gravity = np.asarray(self._spec["gravity"]["value"])[0]
        for body in self._bodies:
            body["velocity"] += gravity * self.time_step
            body["position"] += body["velocity"] * self.time_step
            below = body["position"][:, -1] < 0
            body["position"][below, -1] *= -1
            body["velocity"][below, -1] *= -0.5
        self.step += 1
        self.time = self.step * self.time_step
        if self.step == self.leave_at:
            body = self._bodies[0]
            gone = (0, body["id"][:2].copy(), body["position"][:2].copy(), self.step, "delete")
            self._removed.append(gone)
            for key in body:
                body[key] = body[key][2:]
        for i, sensor in enumerate(self._spec["sensors"]):
            interval = sensor["interval"]
            k = int(self.time / interval + 1e-9) if interval else self.step
            if k > self._last[i]:
                self._last[i] = k
                self._pending[i][0].append(self.time)
                self._pending[i][1].append(self._sample(i))
        if self.delay:
            time.sleep(self.delay)

    def run(self, steps, until, wall):
        began = time.monotonic()
        done = 0
        reason = "steps"
        while steps != 0:
            if self.time >= until:
                reason = "until"
                break
            if self.fail_at == self.step:
                fault = {
                    "code": "non-finite", "body": self._spec["bodies"][0]["name"],
                    "ids": np.array([3, 7], np.uint64), "step": self.step, "time": self.time,
                    "value": np.nan, "message": "velocity", "grew_since": 4, "speed": 1e6,
                }  # fmt: skip
                return {"reason": "fault", "steps": done, "time": self.time, "fault": fault}
            self._advance()
            steps -= 1
            done += 1
            if time.monotonic() - began > wall:
                reason = "wall"
                break
        return {"reason": reason, "steps": done, "time": self.time}

    def drain(self):
        out = []
        for i, (times, values) in enumerate(self._pending):
            width = len(self.sensor_columns(i)[0])
            out.append((np.array(times), np.array(values).reshape(len(times), width)))
        self._pending = [([], []) for _ in self._pending]
        return out

    def removed(self):
        gone, self._removed = self._removed, []
        return gone

    def attribute_names(self, body):
        return ["id", "position", "velocity", "pressure", "stress", "speed"]

    def attribute(self, body, name):
        b = self._bodies[body]
        if name in b:
            return b[name].copy()
        n, d = b["position"].shape
        if name == "pressure":
            return 1e3 * b["position"][:, -1]
        if name == "speed":
            return np.linalg.norm(b["velocity"], axis=1)
        return np.arange(n * d * d, dtype=float).reshape(n, d, d)

    def attributes(self, body, names):
        return {name: self.attribute(body, name) for name in names}

    def grid(self, name):
        d = self._spec["dimension"]
        return np.full(4, 2.0) if name == "mass" else np.full((4, d), 0.5)

    def save(self):
        state = {"time": self.time, "step": self.step, "last": np.array(self._last, np.int64)}
        for i, body in enumerate(self._bodies):
            state |= {f"body{i}.{k}": v.copy() for k, v in body.items()}
        return state

    def load(self, state):
        self.time, self.step = float(state["time"]), int(state["step"])
        self._last = [int(v) for v in state["last"]]
        for i, body in enumerate(self._bodies):
            for key in body:
                body[key] = np.array(state[f"body{i}.{key}"])

    def timings(self):
        return {"transfer": 0.75, "grid": 0.25}

    def statistics(self):
        return {"sorts": 1, "blocks": 1, "strays": 0}


def build_info():
    return {
        "version": "0.1.0", "compiler": "none", "cuda": False, "openmp": False,
        "instruction_set": "fake", "dimensions": [2, 3], "precisions": ["single", "double"],
        "materials": ["TaitFluid", "FixedCorotated"], "threads": 1,
    }  # fmt: skip


def plan(spec, kind):
    bodies = [
        {"name": b["name"], "particles": b["count"], "bytes_per_particle": 16,
         "columns": [{"name": "position", "reals": 3, "bytes": 12}], "particle_spacing": 0.1}
        for b in spec["bodies"]
    ]  # fmt: skip
    return {
        "bodies": bodies, "grid": {"channels": ["mass", "momentum"], "bytes_per_node": 16},
        "pipeline": "fused", "pipeline_reason": "fake", "kernels": ["all"],
        "time_step": spec["time_step"] or 1e-3, "limited_by": "nothing",
        "memory": {"particles": 1, "sort": 1, "grid": 1, "tables": 1}, "memory_total": 4,
    }  # fmt: skip


def module():
    """Return a stand-in for the compiled module."""
    made = types.ModuleType("libmpm._core")
    made.Engine = type("Engine", (Engine,), {})
    made.build_info = build_info
    made.plan = plan
    return made


def install():
    """Put a stand-in in the place of the compiled module, for a whole process."""
    made = module()
    sys.modules["libmpm._core"] = made
    return made


def smoothed_scene(method):
    """Return `small_scene` with water that falls, smoothed over cells, and assumed rates."""
    import libmpm

    transfer = libmpm.methods.Transfer(scheme="FLIP")
    old = small_scene(method=libmpm.Method(transfer=transfer)).to_dict()
    old["bodies"][0] |= {
        "fbar": None,
        "smoothing": libmpm.methods.Smoothing(method=method).to_dict(),
        "assumed": libmpm.methods.AssumedFields(over="cell", part="volumetric").to_dict(),
        "velocity": (1.5, 1.0, 0.0),
    }
    return libmpm.Scene.from_dict(old)


def small_scene(**changes):
    """Return a scene of two bodies and four sensors with a few hundred particles."""
    import libmpm
    from libmpm import boundaries, materials, sensors, shapes

    arguments = {
        "dimension": 3, "cell_size": 0.1, "lower": (0, 0, 0), "upper": (1, 1, 1),
        "gravity": (0, 0, -9.81), "name": "tank",
    } | changes  # fmt: skip
    scene = libmpm.Scene(**arguments)
    low = scene.lower

    def at(*point):
        return tuple(a + b for a, b in zip(low, point, strict=True))

    scene.add_body(
        name="water",
        shape=shapes.Box(lower=at(0, 0, 0), upper=at(0.3, 0.3, 0.3)),
        material=materials.TaitFluid(bulk_modulus=1e5),
    )
    scene.add_body(
        name="block",
        shape=shapes.Box(lower=at(0.6, 0.6, 0.6), upper=at(0.8, 0.8, 0.8)),
        material=materials.FixedCorotated(density=500, youngs_modulus=1e5),
    )
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
    scene.add_sensor(name="load", sensor=sensors.LoadCell(boundary="walls", interval=0.01))
    scene.add_sensor(name="gauge", sensor=sensors.WaveGauge(position=at(0.5, 0.5, 0)[:2]))
    scene.add_sensor(
        name="track", sensor=sensors.ParticleTracker(body="block", ids=(220, 221), interval=0.02)
    )
    scene.add_sensor(name="energy", sensor=sensors.Energy(interval=0.003))
    return scene
