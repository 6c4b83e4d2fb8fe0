"""Linear regression: least squares, covariance, cross-validation and observability."""
