"""What the parts of the PhantomX are called. Imports no jax, so that damage can be named before devices are set up."""

LEGS = ("rf", "rm", "rr", "lf", "lm", "lr")
SEGMENTS = ("coxa", "femur", "tibia")
JOINTS = tuple(f"{segment}_{leg}" for leg in LEGS for segment in SEGMENTS)
