"""The data set: flights as Parquet, splits of them, rows that models read, and the check that
nothing leaks.
"""
