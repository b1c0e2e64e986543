"""Recorded flights on disk: tlog, video, frame table, camera_info, and the recorder that writes them."""
