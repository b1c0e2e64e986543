"""One page of a flight that opens from the file system: what was below, the video, plots, events, settings, health."""
