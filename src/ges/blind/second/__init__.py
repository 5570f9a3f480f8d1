"""The same effects read from the papers by a second author.

Nothing here is taken from the first generator or from the simulator's effects, neither code nor
form. What both of those share by accident does not hold here. ``tests/blind/test_second.py`` fails
where an import crosses, or where a candidate can reach all of an effect whose form is a choice.
"""
