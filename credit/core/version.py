"""The version of this code, by semantic versioning."""

__version__ = "0.2.0"
