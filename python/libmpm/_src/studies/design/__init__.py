"""Design formulas and their register; see `libmpm.design`."""
