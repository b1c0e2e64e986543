"""Simulated hardware: a world with a camera, and a vehicle with its autopilot."""
