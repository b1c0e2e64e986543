"""Simulated hardware: a world of textured surfaces, the camera that sees it, the vehicle that flies over it."""
