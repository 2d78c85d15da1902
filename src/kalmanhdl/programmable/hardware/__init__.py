"""The hardware of a shape."""
