"""Models of the ground effect factor ahead of time, behind scikit-learn's contract, and their
comparison.
"""
