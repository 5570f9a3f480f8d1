"""Recordings: one reader a format, and the recording set that everything else works on."""
