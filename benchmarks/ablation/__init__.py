"""What each setting is worth: preset default with one of them changed at a time."""
