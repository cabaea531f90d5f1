"""Compiled inner loops of the inversion: floats and arrays in and out, serial, without the GIL."""
