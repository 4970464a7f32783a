"""What a terminal needs: arguments, devices, signals, progress, and how a command ends."""
