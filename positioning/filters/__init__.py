"""Recursive estimators that several studies share: resampling, particle filters, Kalman filters."""
