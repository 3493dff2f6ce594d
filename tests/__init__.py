"""Tests, each beside the module of the same path, and the banks that measure the product."""

import os

# before numpy, which takes as many threads as it is told when it is loaded; as in `app`, which banks do not import
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
