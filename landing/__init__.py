"""The mathematics of landslope: from images and attitudes to the surface below and the decision to land.

Pure functions and small estimators with a ``step``; no I/O, no threads, no clock. Frames, signs and units:
``docs/conventions.md``. The public names are those of ``__all__`` (``docs/library.md``); they are imported when they
are first used, since programs that only need the options should not wait for OpenCV.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from landing.errors import LandingError
    from landing.estimate import SurfaceEstimate
    from landing.observation import Observation
    from landing.options import Options
    from landing.pipeline import SurfacePipeline
    from landing.rotations import matrix_from_euler
    from landing.vision.camera import CameraModel

__all__ = [
    "CameraModel",
    "LandingError",
    "Observation",
    "Options",
    "SurfaceEstimate",
    "SurfacePipeline",
    "matrix_from_euler",
]

_MODULES = {
    "CameraModel": "landing.vision.camera",
    "LandingError": "landing.errors",
    "Observation": "landing.observation",
    "Options": "landing.options",
    "SurfaceEstimate": "landing.estimate",
    "SurfacePipeline": "landing.pipeline",
    "matrix_from_euler": "landing.rotations",
}


def __getattr__(name: str) -> Any:
    """The public name, from its module."""
    if name not in _MODULES:
        raise AttributeError(f"module 'landing' has no attribute '{name}'")
    return getattr(importlib.import_module(_MODULES[name]), name)
