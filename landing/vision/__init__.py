"""The picture side: camera model, corners, tracks between frames, reference patches and their warps."""
