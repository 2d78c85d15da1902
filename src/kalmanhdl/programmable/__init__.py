"""Hardware that is a shape, and filters that are images of its control store."""
