"""From estimates to a verdict, and from a verdict to at most one request: the decision and the permission."""
