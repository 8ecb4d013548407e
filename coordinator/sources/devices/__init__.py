"""Depth cameras that are connected to this host, one module per vendor, which is loaded on use."""
