"""Offline experiments: what the predictions of the data set's test flights say. Tables lie in
``results/offline/``.
"""
