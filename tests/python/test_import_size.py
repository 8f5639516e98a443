"""What `import libmpm` loads: what a scene is made of, and neither studies nor files nor pictures.

The test counts modules, not seconds: a first import in a fresh interpreter.
"""

import json
import pkgutil
import subprocess
import sys
from pathlib import Path

import libmpm._src.base.values as values

PACKAGE = Path(values.__file__).parents[2]

#: Modules of others that a first scene needs nothing of.
OTHERS = (
    "asyncio", "concurrent", "h5py", "html", "importlib.resources", "matplotlib",
    "multiprocessing", "scipy", "tempfile", "tqdm",
)  # fmt: skip
#: Modules of the package that are loaded on first use.
LATE = (
    "libmpm._core", "libmpm._src.advice", "libmpm._src.cli", "libmpm._src.compat",
    "libmpm._src.flumes",
    "libmpm._src.boundaries.distance_field", "libmpm._src.grids.functions", "libmpm._src.output",
    "libmpm._src.pictures", "libmpm._src.run.backends", "libmpm._src.run.plan",
    "libmpm._src.run.simulation", "libmpm._src.scene.checks", "libmpm._src.shapes.filling",
    "libmpm._src.studies", "libmpm.advice", "libmpm.analysis", "libmpm.cases", "libmpm.compat",
    "libmpm.debris", "libmpm.demand", "libmpm.design", "libmpm.flumes", "libmpm.grids",
    "libmpm.studies",
)  # fmt: skip


def fresh(code):
    """What a new interpreter prints as JSON."""
    script = f"import sys, json; sys.path.insert(0, {str(PACKAGE.parent)!r})\n{code}"
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=120
    )
    return json.loads(done.stdout)


def under(names, roots):
    return sorted(n for n in names if any(n == r or n.startswith(f"{r}.") for r in roots))


def test_import_loads_what_a_scene_is_made_of():
    # What the interpreter itself loads at its start (files of site-packages may) does not count.
    new = fresh(
        "old = set(sys.modules); import libmpm; print(json.dumps(sorted(set(sys.modules) - old)))"
    )
    assert under(new, OTHERS) == []
    assert under(new, LATE) == []
    own = under(new, ["libmpm"])
    assert len(own) <= 80, f"{len(own)} modules of libmpm are loaded: {own}"


def test_late_modules_are_attributes():
    names = fresh(
        "import libmpm; print(json.dumps([getattr(libmpm, n).__name__ for n in libmpm.__all__"
        " if hasattr(getattr(libmpm, n), '__name__')]))"
    )
    assert {"libmpm.analysis", "libmpm.debris", "libmpm.demand", "libmpm.design"} <= set(names)
    assert "Plan" in names


def test_values_of_late_modules_are_read_from_their_description():
    found = fresh(
        "import libmpm\n"
        "from libmpm._src.base.values import from_plain\n"
        "made = from_plain({'type': 'UniformAngles', 'low': 0.0, 'high': 10.0})\n"
        "print(json.dumps(made.to_dict()))"
    )
    assert found["type"] == "UniformAngles"


def test_every_value_of_a_late_module_can_be_found():
    import libmpm._src

    loaded = fresh(
        "import libmpm\nfrom libmpm._src.base.values import registry\n"
        "print(json.dumps(sorted(registry)))"
    )
    code = "\n".join(
        f"import {module.name}"
        for module in pkgutil.walk_packages(libmpm._src.__path__, "libmpm._src.")
        if not any(part in module.name for part in ("_src.cli", "_src.compat"))
    )
    every = fresh(
        f"{code}\nfrom libmpm._src.base.values import registry\n"
        "print(json.dumps({k: v.__module__ for k, v in registry.items()}))"
    )
    missing = {k: m for k, m in every.items() if k not in loaded and values._LATE.get(k) != m}
    assert not missing, f"values._LATE lacks {missing}"
