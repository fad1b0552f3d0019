"""Frame-to-model registration: follows whatever surface the first view showed."""
