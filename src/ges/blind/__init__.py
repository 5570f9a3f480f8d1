"""Concealed cases: make recordings with hidden physics, diagnose them blind, open the seal, score.

The generator (everything but ``score`` and what it calls) has its own physics and shares no code
with the simulator or with the candidate effects: a tool that names what it was not told of must do
so against physics that somebody else wrote.
"""
