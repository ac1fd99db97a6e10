"""Many pictures of many scenes by worker processes, of which any may be killed at any time."""
