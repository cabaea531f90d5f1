"""Lamps on the ground of a planet, as its air shows them."""
