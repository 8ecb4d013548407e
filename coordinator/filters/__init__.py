"""The filters: pure functions from the belief after one frame to the belief after the next."""
