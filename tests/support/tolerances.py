"""The bounds of the validation tests, in one place, each with its source or derivation."""

# Equation of state, relative error against a 50-digit reference, |j| from 1e-15 to 1e-2.
EQUATION_OF_STATE = {"single": 5e-7, "double": 1e-15}

# Bar against a wall, parts of the closed form v A sqrt(rho E), 2 sqrt(m / k) and 2 m v.
BAR_PLATEAU = 0.015
BAR_DURATION = 0.015
BAR_IMPULSE = (-0.02, 0.005)

# Tank that gravity hits at t = 0: largest deviation of the wall force over one period, parts of
# rho g H^2 / 2, at cells of H/32 and H/64, from the column that the held nodes leave; the least
# ratio of the two errors against the full column (2: first order); and the deviation of the mean
# over whole periods once it has settled.
ACOUSTIC = {0.1: 0.06, 0.05: 0.03}
ACOUSTIC_ORDER = 1.7
WALL_FORCE = 0.003

# Tank at rest after 1e5 steps, parts of rho g H and of sqrt(g H).
REST_PROFILE = 0.01
REST_EDGE_CELL = 0.02
REST_SPEED = 1e-4

# Buoyancy, in cells and parts of rho g V.
FLOAT_DRIFT = 0.1
FLOAT_SETTLED = 0.3
SUBMERGED_FORCE = 0.03

# Rounding, relative to the largest value of the quantity. A run of n steps may multiply the unit
# of the precision by a few n where the motion itself does not amplify differences. Mixed: what goes
# through the grid is single.
ROUNDING = {"single": 2e-6, "mixed": 2e-6, "double": 5e-15}

# CPU in double precision against the naive method, 100 steps, relative to one cell, the fastest
# particle or the largest stress. Both sum the same numbers in different orders.
REFERENCE = 1e-10
