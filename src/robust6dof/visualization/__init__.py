"""Overlays, videos and plots."""
