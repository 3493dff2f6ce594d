"""Recordings of one robot axis at any operating point, made without the product's simulator.

Other figures are measured on sounds whose motion is that of the library. Here the motion, its speed, its stroke and the
payload are free, and the physics is written a second time: `gearboxes` and `sound` share no code with the product.
"""
