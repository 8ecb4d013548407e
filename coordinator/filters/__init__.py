"""The filters: pure functions from the belief of one frame to the next."""
