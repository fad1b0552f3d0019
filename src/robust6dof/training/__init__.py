"""Targets, losses and one plain loop."""
