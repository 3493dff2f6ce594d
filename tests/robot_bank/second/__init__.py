"""A second bank of robots: other builds, servos in closed loop by forward dynamics, another law of friction.

See the README beside the first bank, which this one shares its scorer, its way to the product and its lines of results with.
"""
