"""Closed-loop experiments: conditions, flights, their metrics, and the fit of the simulator's free
numbers.
"""
