"""The critic as a posterior: samples of it, decisions drawn from it, commitment to them. Knows no environment."""
