"""Messages as MCAP channels for Foxglove and other robotics tools."""
