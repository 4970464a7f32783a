"""The one compiled program: every lane's robots act, are simulated, remember and learn in one jitted chunk."""
