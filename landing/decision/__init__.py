"""From estimates to a verdict (fit, unfit, unknown); from the verdict and the pilot's permission to at most one request
to land, or to the setpoints of one landing procedure."""
