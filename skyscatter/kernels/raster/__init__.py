"""Compiled inner loops of dehazing: floats and arrays, no files, no units; outputs are passed in."""
