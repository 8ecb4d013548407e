"""The tracker's stated uncertainty compared with its errors, and the fit of its weights."""
