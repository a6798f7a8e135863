"""Set-up of the tests."""

import os

if "PYTEST_XDIST_WORKER" in os.environ:  # one thread each: threads of several workers would wait for one another
    os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    import numba

    numba.set_num_threads(1)
