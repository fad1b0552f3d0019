"""Keypoint pairs to a pose change."""
