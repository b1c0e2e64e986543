"""What a process frees stays with it: no frame pays for fresh pages."""

import subprocess
import sys

FAULTS = """
import resource, numpy as np
from drivers.process_memory import keep_freed_memory
print(keep_freed_memory())
def faults():
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt
def frame():
    for size in (50_000, 150_000, 600_000):
        np.ones(size, np.uint8)[::4096].sum()
frame()
before = faults()
for _ in range(200):
    frame()
print(faults() - before)
"""


def test_memory_freed_is_used_again_without_page_faults():
    done = subprocess.run([sys.executable, "-c", FAULTS], capture_output=True, text=True, check=True)
    told, faults = done.stdout.split()
    assert told == "True"
    # a fresh page each 4096 bytes would be 39,000
    assert int(faults) < 400
