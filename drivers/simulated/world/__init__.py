"""Simulated ground and the camera that looks at it: surfaces, textures, lens, rendering, truth."""
