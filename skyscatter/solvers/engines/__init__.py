"""Solved skies in the form in which real-time engines load them."""
