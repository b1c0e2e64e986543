"""What a process frees stays with it: no frame pays for fresh pages."""

import subprocess
import sys

FAULTS = """
import resource, sys, numpy as np
from drivers.system.process_memory import keep_freed_memory
if sys.argv[1] == "keep":
    assert keep_freed_memory()
def faults():
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt
def frame():
    pictures = [np.ones(1 << 20, np.uint8) for _ in range(30)]
    return len(pictures)
frame()
before = faults()
for _ in range(20):
    frame()
print(faults() - before)
"""
PAGES = 20 * 30 * 256
"""All there are in the pictures of twenty frames, 4096 bytes each."""


def faults(how: str) -> int:
    run = [sys.executable, "-c", FAULTS, how]
    return int(subprocess.run(run, capture_output=True, text=True, check=True).stdout)


def test_memory_freed_is_used_again_without_page_faults():
    assert faults("keep") < 0.01 * PAGES
    assert faults("leave") > 0.5 * PAGES, "there is nothing to be gained"
