"""Compiled loops of dehazing; how they are compiled is told in `skyscatter.solvers.kernels.jit`."""
