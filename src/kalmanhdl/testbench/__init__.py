"""The test bench that a build ships: its steps, its vectors, and its folder."""
