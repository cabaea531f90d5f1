"""Wavelength grids, tables over wavelength, the Sun's spectrum and the albedo of surfaces."""
