"""From results to responses, and statistics of responses; see `libmpm.analysis`."""
