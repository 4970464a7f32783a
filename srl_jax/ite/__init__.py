"""Intelligent trial and error: gaits, the map made of them, trials after damage, and models of the damage itself."""
