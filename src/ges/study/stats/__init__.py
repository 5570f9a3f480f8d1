"""Statistics of experiments whose unit is the seed: intervals, paired differences, correction for
many tests.
"""
