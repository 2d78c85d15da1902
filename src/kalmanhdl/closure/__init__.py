"""Closing the clock: what a placement told of its longest path goes back into the schedule."""
