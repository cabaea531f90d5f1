"""A sky in a window: tables of skies that are drawn at once for any Sun and view, and the page that draws them."""
