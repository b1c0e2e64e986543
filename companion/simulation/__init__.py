"""Simulated flights in closed loop, by scenario or by the hundred, and how they are judged."""
