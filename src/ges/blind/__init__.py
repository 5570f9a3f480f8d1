"""Concealed cases: make recordings with hidden physics, diagnose them blind, open the seal, score.

The generator (everything but ``score`` and what it calls) has its own physics. It shares no code
with the simulator or with the candidate effects: what a tool names blind it must find in somebody
else's physics.
"""
