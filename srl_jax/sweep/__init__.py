"""Sweeps: packs of lanes, each an ordinary run that resumes, under an engine that machine or cluster already have."""
