"""Lanes refine what one refines alone, byte for byte, whatever their number and what they refined before."""

from __future__ import annotations
