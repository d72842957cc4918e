"""Errors of models on flights that they were not fitted to.

prediction: errors on flights that a model has not seen. folds: each flight held out
once.
"""
