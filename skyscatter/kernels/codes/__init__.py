"""Numbers by which kernels know kinds of things; without the compiler, so that what is described need not load it."""
