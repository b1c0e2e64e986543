"""What a frame costs on this machine, and the daemon's latency, memory and start."""
