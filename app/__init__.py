"""HTTP, web pages, command line and jobs: the only code that knows how the world reaches Gearcase."""

import os

# Matrices here are small: threads of BLAS wait for each other longer than they work, above all on a busy machine.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
