"""Plain pictures without metadata: a veil is fitted to the whole picture and taken off; relative, not reflectance."""
