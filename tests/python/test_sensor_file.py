"""The sensor file: growth, trimming, CSV, and real kills while it is written."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time

import h5py
import numpy as np
import pytest

from libmpm._src.output.sensor_file import SensorFile, append_csv, read_sensors
from libmpm._src.output.series import Series


def make(name="load", width=3):
    letters = "abcdefgh"[:width]
    return Series(name, tuple(letters), ("N",) * width, {"kind": "load-cell", "interval": 0.01})


def add(series, count):
    first = len(series)
    time = np.arange(first + 1, first + count + 1, dtype=float)
    series.append(time, time[:, None] * np.arange(1, len(series.components) + 1))


def test_series_grow_and_return_copies():
    series = make()
    for count in (1, 100, 3):
        add(series, count)
    assert len(series) == 104
    assert (series.time == np.arange(1, 105)).all()
    series.values[:] = 0
    assert series.values[-1, 2] == 312


def test_file_follows_the_series_and_reads_plainly(tmp_path):
    path = tmp_path / "sensors.h5"
    series = [make("load"), make("empty"), make("a/b", 1)]
    file = SensorFile(path, series)
    for count in (0, 1, 63, 9000, 5, 40000):
        add(series[0], count)
        add(series[2], 2)
        file.flush()
        found = read_sensors(path)
        for one in series:
            assert (found[one.name].time == one.time).all()
            assert (found[one.name].values == one.values).all()
    file.close()
    with h5py.File(path) as plain:
        group = plain["load"]
        assert group["time"].shape == (49069,)
        assert group["values"].shape == (49069, 3)
        assert group.attrs["components"].astype("U").tolist() == ["a", "b", "c"]
        assert group.attrs["units"].astype("U").tolist() == ["N"] * 3
        assert group["time"].attrs["unit"] == b"s"
        assert group.attrs["kind"] == b"load-cell"
        assert plain["empty/values"].shape == (0, 3)
    add(series[0], 7)
    file.flush()
    assert len(read_sensors(path)["load"]) == 49076


def test_appends_never_change_the_structure(tmp_path):
    """An append inside a chunk writes values and one length: the file does not grow."""
    path = tmp_path / "sensors.h5"
    series = make()
    add(series, 1)
    file = SensorFile(path, [series])
    size, inode = path.stat().st_size, path.stat().st_ino
    for _ in range(50):
        add(series, 20)
        file.flush()
    assert (path.stat().st_size, path.stat().st_ino) == (size, inode)


def test_reader_trims_to_the_shorter_series(tmp_path):
    path = tmp_path / "sensors.h5"
    series = make()
    add(series, 10)
    SensorFile(path, [series]).close()
    with h5py.File(path, "r+") as file:
        file["load/values"].resize(12, axis=0)
    assert len(read_sensors(path)["load"]) == 10


def test_csv_is_extended_and_keeps_every_digit(tmp_path):
    path = tmp_path / "load.csv"
    series = make()
    series.append(np.array([0.1]), np.array([[1 / 3, 2e-17, -1e300]]))
    append_csv(path, series, 0)
    add(series, 2)
    append_csv(path, series, 1)
    lines = path.read_text().splitlines()
    assert lines[0] == "time [s],a [N],b [N],c [N]"
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    assert (table[:, 0] == series.time).all()
    assert (table[:, 1:] == series.values).all()


WRITER = """
import sys
from pathlib import Path
import numpy as np
from libmpm._src.output.sensor_file import SensorFile
from libmpm._src.output.series import Series
series = [Series(f"s{i}", tuple("abc"), ("N",) * 3) for i in range(4)]
file = SensorFile(Path(sys.argv[1]), series)
rng = np.random.default_rng(int(sys.argv[2]))
while True:
    for s in series:
        n = int(rng.integers(0, 400))
        time = np.arange(len(s) + 1, len(s) + n + 1, dtype=float)
        s.append(time, time[:, None] * [1, 2, 3])
    file.flush()
    print(*(len(s) for s in series), flush=True)
"""


@pytest.mark.parametrize("seed", range(6))
def test_after_a_kill_the_file_opens_with_every_flushed_sample(tmp_path, seed):
    path = tmp_path / "sensors.h5"
    child = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(path), str(seed)],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert child.stdout is not None
    lines = [child.stdout.readline()]
    time.sleep(random.Random(seed).uniform(0.0, 0.3))
    child.send_signal(signal.SIGKILL)
    lines += child.stdout.read().splitlines(keepends=True)
    child.wait()
    flushed = [int(n) for n in [line for line in lines if line.endswith("\n")][-1].split()]
    with h5py.File(path) as plain:
        assert len(plain) == 4
    for series, least in zip(read_sensors(path).values(), flushed, strict=True):
        assert len(series) >= least
        assert (series.time == np.arange(1, len(series) + 1)).all()
        assert (series.values == series.time[:, None] * [1, 2, 3]).all()
