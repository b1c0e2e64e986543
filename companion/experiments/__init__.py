"""The paper's experiments on simulated cameras: one module a figure, a runner and a report."""
