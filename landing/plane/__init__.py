"""Estimators of the plane below, their covariances, fusion over time, and what follows: slope, inclination, height."""
