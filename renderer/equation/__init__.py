"""The rendering equation's estimator: one kernel, its sampling techniques and its random numbers."""
