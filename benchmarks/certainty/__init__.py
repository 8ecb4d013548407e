"""Whether the tracker's word on how sure it is holds, and the fit of what it goes by."""
