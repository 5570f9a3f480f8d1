"""GES: simulation, control and diagnosis of multirotors near irregular ground."""

__version__ = "0.1.0"
