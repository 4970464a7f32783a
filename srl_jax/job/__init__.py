"""Everything around a run: its plan and memory, its teachers, the loop, and its files."""
