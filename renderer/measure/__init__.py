"""Speed against accuracy, and what an estimator does at one point."""
