"""The C library's allocator: what a process frees stays with it."""

import ctypes
import sys

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
"""mallopt's numbers for them, malloc.h of the GNU C library."""
_KEPT_BYTES = 64 << 20
_LARGEST_BYTES = 16 << 20


def keep_freed_memory() -> bool:
    """Let the allocator keep what is freed, up to 64 MB, instead of giving it back; False where that is not possible.

    Every frame frees and takes anew some arrays of the size of a picture. By default the GNU C library gives such
    memory back to the kernel at once, or does not, as the heap happens to lie: in some processes every frame then pays
    for fresh pages, up to a fifth of its time.
    """
    if not sys.platform.startswith("linux"):
        return False
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError):
        return False  # another C library
    mallopt.argtypes, mallopt.restype = (ctypes.c_int, ctypes.c_int), ctypes.c_int
    return bool(mallopt(_TRIM_THRESHOLD, _KEPT_BYTES)) and bool(mallopt(_MMAP_THRESHOLD, _LARGEST_BYTES))
