"""Compiled inner loops: floats and arrays in and out."""
