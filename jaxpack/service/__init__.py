"""Orders over HTTP: an event loop that gathers them, and processes that pack them."""
