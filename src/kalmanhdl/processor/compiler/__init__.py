"""The compiler: a filter traced on whole matrices becomes a program of the processor."""
