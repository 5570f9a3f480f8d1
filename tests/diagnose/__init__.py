"""Tests of the diagnosis: those in the folders of its rooms are arithmetic on numbers made by hand,
and quick; those beside them fly.
"""
