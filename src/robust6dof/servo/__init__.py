"""Interaction matrices and PAD-Servo."""
