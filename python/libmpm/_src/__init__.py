"""Implementation of libmpm; import the public names from `libmpm` and its modules."""
