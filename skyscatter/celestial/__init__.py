"""Bodies and lights of the sky as an observer on the Earth sees them, outside the air."""
