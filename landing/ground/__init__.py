"""What the plane leaves: relief, roughness, and whether the ground to land on is seen."""
