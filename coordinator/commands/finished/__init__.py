"""What each command does with a run that is finished: evaluate, export, draw, view, report."""
