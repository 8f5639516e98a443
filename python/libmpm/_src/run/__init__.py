"""Running a scene: plan, simulation, guards, ranks, checkpoints taken up again."""
