"""Write the demonstration scene, python/libmpm/data/surge.json.

A reservoir of water is released at one end of a channel, picks up six floating blocks in two rows
of three and drives them into a raised rigid box. Run ``python tools/make_demo_scene.py``; with
``--check`` it fails if the committed file differs.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import libmpm
from libmpm import boundaries, materials, sensors, shapes
from libmpm._src.scene.run_file import RunFile, RunSettings

TARGET = Path(__file__).resolve().parents[1] / "python" / "libmpm" / "data" / "surge.json"

CELL = 0.05
BLOCK = (0.3, 0.1, 0.1)
#: Lower corners of the blocks on the dry bed. The rows keep three cells to the planes of the box's
#: sides, so that no block can hang beside it, and two cells to each other, so that they part.
ROWS = (0.25, 0.45)
COLUMNS = (3.0, 3.45, 3.9)
#: The box: its bottom lies two cells above the bed, so a block on the bed passes beneath.
STRUCTURE = ((4.8, 0.1, 0.1), (5.1, 0.7, 0.7))


def build() -> RunFile:
    """Return the scene with its run settings."""
    scene = libmpm.Scene(
        dimension=3,
        cell_size=CELL,
        lower=(0, 0, 0),
        upper=(6.4, 0.8, 1.2),
        gravity=(0, 0, -9.81),
        name="surge",
    )
    scene.add_body(
        name="water",
        shape=shapes.Box(lower=(0, 0, 0), upper=(2.5, 0.8, 0.8)),
        material=materials.TaitFluid(density=1000, bulk_modulus=1.6e6),
        particles_per_cell=8,
        hydrostatic=0.8,
    )
    debris = []
    for y in ROWS:
        for x in COLUMNS:
            lower = (x, y, 0.0)
            debris.append(
                scene.add_body(
                    name=f"block-{len(debris) + 1}",
                    shape=shapes.Box(
                        lower=lower,
                        upper=tuple(round(a + b, 9) for a, b in zip(lower, BLOCK, strict=True)),
                    ),
                    material=materials.FixedCorotated(
                        density=600, youngs_modulus=1.2e6, poissons_ratio=0.3
                    ),
                    particles_per_cell=8,
                )
            )
    scene.add_boundary(name="channel", shape=shapes.DomainWalls(), response=boundaries.Separable())
    lower, upper = STRUCTURE
    scene.add_boundary(
        name="structure",
        shape=shapes.Box(lower=lower, upper=upper),
        response=boundaries.Separable(),
    )
    scene.add_sensor(name="load", sensor=sensors.LoadCell(boundary="structure", interval=1e-3))
    scene.add_sensor(
        name="gauge", sensor=sensors.WaveGauge(position=(4.5, 0.4), interval=5e-3, body="water")
    )
    settings = RunSettings(
        until=2.5,
        frame_interval=0.05,
        checkpoint_interval=0.5,
        attributes=["speed", "pressure"],
        filter=0.005,
        debris=debris,
    )
    return RunFile(scene, settings)


def main() -> int:
    """Write the file, or compare with it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="compare instead of writing")
    text = json.dumps(build().to_dict(), indent=2, ensure_ascii=False) + "\n"
    if parser.parse_args().check:
        current = TARGET.read_text(encoding="utf-8") == text
        print(f"{TARGET.name} is {'current' if current else 'not current'}")
        return 0 if current else 1
    TARGET.write_text(text, encoding="utf-8")
    print(f"wrote {TARGET}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
