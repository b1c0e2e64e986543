"""Recorded flights, videos and image folders through the core, and the summary, plot and video of each."""
