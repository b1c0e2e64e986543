"""The experiments of the method's paper, run again, with a report."""
