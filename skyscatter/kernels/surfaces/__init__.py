"""Kernels of scenes with surfaces: what rays meet, what it does to light, where light comes from."""
