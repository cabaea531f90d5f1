"""Plain pictures without metadata: a veil is fitted to the whole picture and taken off.  The result is relative, not reflectance."""
