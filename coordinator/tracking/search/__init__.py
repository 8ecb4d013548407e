"""Where a body is that may be anywhere, in any pose: candidates of a library, refined in stages."""
