"""Certificates and access control."""
