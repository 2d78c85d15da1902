"""The papers' experiments: one file a paper, its figures as values."""
