"""Surfaces, what they are made of, the media between them, and lamps: the parts of a scene that light meets."""
