"""The mathematics of landslope: from images and attitudes to the surface below and the decision to land.

Pure functions and small estimators with a ``step``; no I/O, no threads, no clock. Frames, signs and units:
``docs/conventions.md``.
"""
