"""The only place that knows Zenoh."""
