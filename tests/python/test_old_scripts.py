"""Scripts and notebooks of version 0.1, as it had them, run: their own assertions hold.

Its notebooks that assert pressures and loads at walls do so with the walls that they were written
for, `cell="held"`, as the changelog says. One that compares a sum of its own with a tracker's does
so to the rounding of NumPy's sum: the engine adds exactly now.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import libmpm

FOLDER = Path(__file__).parents[1] / "data" / "scripts_0.1"
#: Scripts whose assertions are those of walls that hold nodes.
HELD = ("hydrostatic-tank", "reading-results")
#: Two ways to a sum: what is written there -> to rounding.
SUMS = {
    'np.array_equal(centre.values, sim.sensors["tracker"].values)':
    'np.allclose(centre.values, sim.sensors["tracker"].values, rtol=1e-13, atol=0)'
}  # fmt: skip


@pytest.mark.parametrize("name", sorted(p.stem for p in FOLDER.glob("*.txt")))
def test_a_script_of_the_version_before_runs(name, tmp_path):
    text = (FOLDER / f"{name}.txt").read_text(encoding="utf-8")
    if name in HELD:
        assert "Slip()" in text
        text = text.replace("Slip()", 'Slip(cell="held")')
    for written, to_rounding in SUMS.items():
        assert (written in text) == (name == "custom-sensor")
        text = text.replace(written, to_rounding)
    text = text.replace("sim.run(until=1.0)", "sim.run(until=0.05)")  # it takes half a minute
    script = tmp_path / "script.py"
    script.write_text(text, encoding="utf-8")
    package = Path(libmpm.__file__).parents[1]
    found = os.pathsep.join([str(package), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "-W", "ignore", script], cwd=tmp_path, capture_output=True, text=True,
        timeout=250, env=os.environ | {"MPLBACKEND": "Agg", "PYTHONPATH": found},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
