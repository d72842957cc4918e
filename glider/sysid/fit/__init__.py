"""What models make of flights that they were not fitted to, and flights to fit to.

prediction: errors on flights that a model has not seen. folds: each flight held out
once. simulate: campaigns with a known truth.
"""
