"""A second bank of robots: other builds, servos in closed loop by forward dynamics, another law of friction.

It shares with the first bank how answers are judged, the way to the product, and how runs are kept: see its README.
"""
