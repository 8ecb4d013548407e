"""The filters: pure functions from one frame's belief to the next; the paper's is `gradient_enhanced`."""
