"""The command line's words: arguments, options, what they mean, and files of them."""
