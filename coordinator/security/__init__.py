"""Certificates, and who is let in."""
