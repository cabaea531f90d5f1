"""Steps of the small programs that densities in three dimensions are, and how their columns are found."""

#: Analytic shapes.
SPHERE, GAUSSIAN_SPHERE, POWER_LAW, BONNOR_EBERT, SHELL, GAUSSIAN_SHELL = 0, 1, 2, 3, 4, 5
DISK, CONE, BOX, FILAMENT, TURBULENCE, FRONT, AROUND = 6, 7, 8, 9, 10, 11, 12
#: Leaves up to here are analytic shapes.
LAST_SHAPE = 49
#: Leaves with data of their own.
VOXELS, PARTICLES = 50, 51
#: Operations: a b -> a b; a + b; factor a; a carved by b; a^p; a warp of the coordinates begins, ends; past the
#: next product if a is zero.
PRODUCT, SUM, SCALE, CARVE, POWER, WARP, UNWARP, GATE = 100, 101, 102, 103, 104, 105, 106, 107
#: How a term's column is found: PIECES are constant between the edges of their shapes; nobody asks for the column of
#: what is TRANSPARENT, such as gas that only shines.
CLOSED_FORM, CELLS, QUADRATURE, PIECES, TRANSPARENT = 0, 1, 2, 3, 4
#: Values that a running program may keep, and warps within one another.
STACK, FRAMES = 64, 8
#: Profiles around a filament.
GAUSSIAN_PROFILE, PLUMMER_PROFILE = 0, 1
#: Modes of one component of a warp's displacement.
WARP_MODES = 8
#: Particles for which a leaf of their tree has room.
ROOM = 16
