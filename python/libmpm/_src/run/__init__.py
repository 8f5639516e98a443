"""Running a scene: plan, simulation, guards, ranks, restart."""
