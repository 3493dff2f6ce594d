"""Tests, each beside the module of the same path, and the banks that measure the product."""

import app as app  # before numpy, which takes as many threads as it is told when it is loaded
