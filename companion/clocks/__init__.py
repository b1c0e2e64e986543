"""The relation of two clocks: from late arrivals, round trips and the stamps of frames; what was inferred can be undone."""
