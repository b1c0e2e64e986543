"""Numeric libraries with one thread each: the tests' workers fill the processors, and threads that wait for each other
only cost time.

To be imported before NumPy and OpenCV are loaded, which read these; processes that a test starts inherit them.
"""

import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"):
    os.environ.setdefault(variable, "1")
