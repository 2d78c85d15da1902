"""The processor in Amaranth: each unit of the paper a component under its own name."""
