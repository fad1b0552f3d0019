"""Segmenters with weights, each an extra, imported lazily."""
