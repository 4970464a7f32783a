"""A policy for every damage, made before any happens; after it, the posterior over damages, and who walks."""
