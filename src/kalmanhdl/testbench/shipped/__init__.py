"""Files that go into a test bench as they are."""
