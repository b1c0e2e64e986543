"""What landslope says, in the formats of the robotics tools: MCAP files and the Foxglove app, live."""
