"""Programs for tests: real processes, hosts, certificates, and replacements of workers."""
