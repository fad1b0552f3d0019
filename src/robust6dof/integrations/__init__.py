"""Hardware and middleware, each an extra, imported lazily."""
