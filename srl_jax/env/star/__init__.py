"""A stepper for star-shaped robots: MJX's results at ten times its speed on a CPU (docs/physics.md)."""
