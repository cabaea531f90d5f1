"""The window: skies and nebulae in a browser or a notebook, drawn at once and solved behind."""
