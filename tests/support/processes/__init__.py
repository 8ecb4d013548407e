"""Programs to test with: real processes, hosts, certificates, and workers that stand in for real ones."""
