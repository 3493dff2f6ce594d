"""A bank of logs of simulated six-joint robots, each with one effect hidden in one joint, or none.

The simulation is its own: it shares no code with the product, reaches it through the command line only, and judges what
`gearcase investigate --robot` says. `python -m benchmarks.robot_bank --count 150 --seed 1`. See README.md.
"""
