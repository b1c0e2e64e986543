"""The relation of two clocks, from late arrivals, round trips and frames' stamps; what was inferred can be undone."""
