"""Tests, each beside the module of the same path. Banks that measure the product are in `benchmarks`."""

import app as app  # before numpy, which takes as many threads as it is told when it is loaded
