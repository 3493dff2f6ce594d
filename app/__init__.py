"""HTTP, web pages, command line and jobs: the only code that knows how the world reaches Gearcase."""

import ctypes
import os
import sys

# Matrices here are small: threads of BLAS wait for each other longer than they work, above all on a busy machine.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# glibc gives each thread a heap of its own and keeps what is freed: under load the process would grow and grow.
# Two heaps at most; from 4 MiB on an array is a mapping of its own, which goes when it is freed (for smaller ones the
# mapping costs more than the work).
M_TRIM_THRESHOLD, M_MMAP_THRESHOLD, M_ARENA_MAX = -1, -3, -8
if sys.platform == "linux":
    libc = ctypes.CDLL(None)
    if hasattr(libc, "mallopt"):  # it is glibc
        for option, value in ((M_ARENA_MAX, 2), (M_MMAP_THRESHOLD, 1 << 22), (M_TRIM_THRESHOLD, 1 << 23)):
            libc.mallopt(option, value)
