"""Figures of the paper: one function a figure, each writing a PDF, a PNG and the table it shows."""
