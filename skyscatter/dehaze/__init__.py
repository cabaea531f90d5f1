"""Dehazing of satellite images: the physics of the sky run backwards."""
