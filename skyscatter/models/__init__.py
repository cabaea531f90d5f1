"""Model files: what a sky, a nebula or a scene of surfaces is made of, as TOML."""
