"""Shared by coordinator and worker: body, camera, settings, messages."""
