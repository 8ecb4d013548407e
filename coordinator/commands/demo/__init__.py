"""What gepf is for, in a minute or two: sequences rendered, tracked in two ways, a table, pictures."""
