"""Pictures of scenes and runs: previews, plots, views in three dimensions, animations."""
