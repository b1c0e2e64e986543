"""Pairs of frames with their times and attitudes, and the camera's motion over the plane between them."""
