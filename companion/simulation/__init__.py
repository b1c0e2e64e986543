"""Simulated flights in closed loop, by scenario or by the hundred, and their results."""
