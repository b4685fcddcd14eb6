"""Recordings as Foxglove shows them."""
