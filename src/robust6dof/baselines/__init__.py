"""Other trackers behind the same protocol."""
