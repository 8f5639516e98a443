"""Files of a run: frames, sensor series, checkpoints, reports, exports; and reading them."""
