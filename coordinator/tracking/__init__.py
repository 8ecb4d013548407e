"""People through a sequence: segmentation, detection, filter, estimates. Refinement is an interface."""
