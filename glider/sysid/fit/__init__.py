"""Errors of models on flights that they were not fitted to."""
