"""What matter does to light: scattering, absorption, emission, and where the light goes."""
