"""Readers of recordings and data sets; files of results."""
