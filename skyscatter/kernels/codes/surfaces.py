"""Kinds of what stands in a scene of surfaces, and what happens to light there."""

#: Items.
SPHERE, PLANE, RECTANGLE, BOX, DISK, TRIANGLE = 0, 1, 2, 3, 4, 5
#: Materials.  An INTERFACE only separates media: light passes as if nothing were there.
INTERFACE, LAMBERT, MIRROR, DIELECTRIC, CONDUCTOR, RPV, ROSS_LI, SEA = 0, 1, 2, 3, 4, 5, 6, 7
#: Lamps.
POINT_LAMP, SURFACE_LAMP, PARALLEL_LAMP, SURROUNDINGS = 0, 1, 2, 3
#: What a surface did to a walk, see `bsdf.sample_bsdf`: one of the first three, DELTA added where the direction was no
#: matter of chance.
ABSORBED, REFLECTED, TRANSMITTED, DELTA = 0, 1, 2, 4
#: Media that a ray may be inside of at once.
STACK = 8
